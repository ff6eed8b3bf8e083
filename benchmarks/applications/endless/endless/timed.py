"""A scenario that only ends by time: every episode simulates all of its duration."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np


class Placement(NamedTuple):
    """Start (x m, y m, yaw rad) and a goal that nobody minds."""

    start: np.ndarray
    goals_m: np.ndarray


class Verdict(NamedTuple):
    """Not done, always."""

    goal_index: Any
    done: Any
    reason: Any


class Timed:
    """Judges nothing."""

    arrived_m = None  # nobody goes anywhere: no shortest way is looked for

    def place(self, world: object, floor: object, hull_radius_m: float, rng: np.random.Generator) -> Placement:  # noqa: ARG002 - the contract's
        """Returns a start around the origin, facing any way."""
        return Placement(np.array([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-np.pi, np.pi)]), np.zeros((1, 2)))

    def init(self, start: object, goals_m: object) -> tuple[()]:  # noqa: ARG002 - the contract's
        """Returns no state."""
        return ()

    def step(self, state: tuple[()], truth: object) -> tuple[tuple[()], Verdict]:  # noqa: ARG002 - the contract's
        """Returns that it goes on."""
        none = jnp.zeros((), jnp.int32)
        return state, Verdict(none, jnp.zeros((), bool), none)


def scenario(environment: object) -> Timed:  # noqa: ARG001 - the contract's
    """Returns the scenario."""
    return Timed()
