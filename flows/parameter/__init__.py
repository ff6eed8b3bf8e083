"""Parameters of flows: the store, by URL or block, and no secret in it. Flows and `flows.run` may import it."""
