"""The planar engine, in plain JAX. Only tasks.simulate.engines may import it."""
