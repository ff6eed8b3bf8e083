"""A controller for any robot: swings its actuators, of which ACTUATORS says how many there are, as ``x8``."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp

from benchmarks.applications.explorer.explorer.reactive import Lidar


class Swinging:
    """Scans as the explorer does, and lets the scan change the swing a little, so that it is not left out."""

    lidar = Lidar()

    def __init__(self, actuators: int) -> None:
        self._actuators = actuators

    def init(self, floor: object, goals_m: object) -> tuple[()]:  # noqa: ARG002 - the contract's
        """Returns no state."""
        return ()

    def step(self, state: tuple[()], observation: Any) -> tuple[tuple[()], Any]:  # noqa: ANN401 - the engine's
        """Returns no state, and the control."""
        phase = 0.6 * observation.time_s + jnp.arange(self._actuators) + 0.01 * observation.ranges_m.min()
        return state, 0.5 * jnp.sin(phase)


def controller(environment: Mapping[str, str]) -> Swinging:
    """Returns the controller."""
    return Swinging(int(environment["ACTUATORS"].removeprefix("x")))
