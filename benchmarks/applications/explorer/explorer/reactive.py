"""A controller without a map: on in a wide curve, off from what is near; benchmarks run it in JAX and in NumPy."""

from types import ModuleType
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

# Arrays of either library, one robot or many in the leading axes.
Arrays = Any
_NEAR_M = 0.5


class Lidar(NamedTuple):
    """A planar lidar."""

    rays: int = 32
    range_m: float = 10.0
    height_m: float = 0.2


def control(pose: Arrays, ranges_m: Arrays, time_s: Arrays, numbers: ModuleType) -> Arrays:
    """Returns (forward m/s, turn rad/s, sideways m/s) for a scan taken at a pose."""
    angles = (2 * np.pi * np.arange(Lidar().rays) / Lidar().rays).astype(np.float32)
    push = numbers.maximum(1.0 - ranges_m / _NEAR_M, 0.0)
    off_x, off_y = (push * np.cos(angles)).sum(-1), (push * np.sin(angles)).sum(-1)
    wish = 0.35 * time_s - pose[..., 2]
    ahead, left = numbers.cos(wish) - 0.4 * off_x, numbers.sin(wish) - 0.4 * off_y
    error = numbers.arctan2(left, ahead)
    forward = 0.6 * numbers.maximum(numbers.cos(error), 0.0)
    turn = numbers.clip(3.0 * error, -2.5, 2.5)
    return numbers.stack([forward, turn, 0.0 * turn], axis=-1)


class Reactive:
    """Explores, remembering nothing."""

    lidar = Lidar()

    def init(self, floor: object, goals_m: object) -> tuple[()]:  # noqa: ARG002 - the contract's
        """Returns no state."""
        return ()

    def step(self, state: tuple[()], observation: Any) -> tuple[tuple[()], Any]:  # noqa: ANN401 - the engine's
        """Returns no state, and the control."""
        return state, control(observation.pose, observation.ranges_m, observation.time_s, jnp)


def controller(environment: object) -> Reactive:  # noqa: ARG001 - the contract's
    """Returns the controller."""
    return Reactive()
