"""A scenario of many goals, one after the other, that only ends by time, whatever the robot touches meanwhile."""

from typing import Any, NamedTuple, cast

import jax.numpy as jnp
import numpy as np
from scipy import ndimage

GOALS, ARRIVED_M, _ROOM_M = 100, 0.3, 0.05


class Placement(NamedTuple):
    """Start (x m, y m, yaw rad), and goals (x m, y m) in their order."""

    start: np.ndarray
    goals_m: np.ndarray


class Verdict(NamedTuple):
    """Which goal comes next; not done, always."""

    goal_index: Any
    done: Any
    reason: Any


class Rounds:
    """Sends a robot from place to place; judges nothing."""

    arrived_m = None  # it goes on after the last goal: no shortest way is looked for

    def place(self, world: Any, floor: Any, hull_radius_m: float, rng: np.random.Generator) -> Placement:  # noqa: ANN401 - the contract's
        """Returns the world's start, and goals anywhere within reach."""
        start = (0.0, 0.0, 0.0) if world.start is None else (world.start.x_m, world.start.y_m, world.start.yaw_rad)
        free = floor.clearance_m >= hull_radius_m + _ROOM_M
        parts, _ = cast("tuple[np.ndarray, int]", ndimage.label(free, structure=np.ones((3, 3))))
        column, row = np.rint((np.array(start[:2]) - floor.origin_m) / floor.cell_m).astype(int)
        rows, columns = np.nonzero(free & (parts == parts[row, column]))
        points = floor.origin_m + floor.cell_m * np.stack([columns, rows], axis=1)
        return Placement(np.array(start), points[rng.integers(len(points), size=GOALS)].astype(np.float64))

    def init(self, start: object, goals_m: Any) -> tuple[Any, Any]:  # noqa: ANN401, ARG002 - the contract's
        """Returns the goals, and that none is reached."""
        return goals_m, jnp.zeros((), jnp.int32)

    def step(self, state: tuple[Any, Any], truth: Any) -> tuple[tuple[Any, Any], Verdict]:  # noqa: ANN401 - likewise
        """Returns that it goes on; after the last goal to the last one."""
        goals_m, reached = state
        away = truth.pose[:2] - goals_m[jnp.minimum(reached, GOALS - 1)]
        reached = jnp.minimum(reached + (jnp.sum(away**2) < ARRIVED_M**2), GOALS)
        return (goals_m, reached), Verdict(reached, jnp.zeros((), bool), jnp.zeros((), jnp.int32))


def scenario(environment: object) -> Rounds:  # noqa: ARG001 - the contract's
    """Returns the scenario."""
    return Rounds()
