"""Batched simulation: the only home of JAX and MJX. Flows may import it."""
