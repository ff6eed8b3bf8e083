"""What is kept in the store: worlds, bundles, episodes, and the report of a run. Anyone may import it."""
