"""The batch plan: which episodes, in which order, in which chunks. Chunk, batch and flows may import it."""
