"""A controller whose module hangs when it is imported."""

import time

jax = False
time.sleep(1000.0)


def controller(environment: object) -> None:
    """Is never made."""
