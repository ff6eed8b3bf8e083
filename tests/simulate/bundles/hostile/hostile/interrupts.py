"""A controller whose module interrupts when it is imported."""

jax = False
raise KeyboardInterrupt


def controller(environment: object) -> None:
    """Is never made."""
