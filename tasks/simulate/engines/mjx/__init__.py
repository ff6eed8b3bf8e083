"""The mjx engine. Only tasks.simulate.engines may import it."""
