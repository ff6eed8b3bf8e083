"""A chunk of episodes in, rows out. Batch, audit and replay may import it."""
