"""World generation jobs: worlds made by many processes, kept in the store. Flows may import it."""
