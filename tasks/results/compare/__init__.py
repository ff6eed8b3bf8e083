"""Two batches beside each other. Flows may import it."""
