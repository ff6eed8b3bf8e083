"""A controller whose module leaves when it is imported."""

import os

jax = False
os._exit(0)


def controller(environment: object) -> None:
    """Is never made."""
