"""Export jobs: worlds out of the store, one zip into a bucket. Flows may import it."""
