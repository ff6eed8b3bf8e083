"""The mjx engine. Only tasks.simulate.engine may import it."""
