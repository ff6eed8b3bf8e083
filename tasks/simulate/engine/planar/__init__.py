"""The planar engine, in plain JAX. Only tasks.simulate.engine may import it."""
