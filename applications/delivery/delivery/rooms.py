"""The delivery scenario: from the origin to goals in other rooms, one after the other, without hitting anything."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy import ndimage

if TYPE_CHECKING:
    from specs.world import Rectangle, World
    from tasks.simulate.contract import HostMap

GOALS = 2
ARRIVED_M = 0.3
# What stops the courier's 2 kg from 0.1 m/s at once; brushing along a wall stays far below.
HARD_IMPULSE_NS = 0.2
STUCK_S = 10.0
STUCK_M = 0.15
# Goals stand this clear of the hull, on ways at least that wide.
_GOAL_ROOM_M = 0.15
_WAY_ROOM_M = 0.05
_PASSED, _COLLISION, _STUCK, _OUT_OF_BOUNDS = 0, 1, 3, 4


class Placement(NamedTuple):
    """Start (x m, y m, yaw rad) and goals (x m, y m) in order."""

    start: Float64[np.ndarray, "3"]
    goals_m: Float64[np.ndarray, "goals 2"]


class Progress(NamedTuple):
    """Goals, how many are reached, and since when and where the robot has not got on."""

    goals_m: Float[jax.Array, "goals 2"]
    reached: Int[jax.Array, ""]
    anchor_m: Float[jax.Array, "2"]
    anchored_s: Float[jax.Array, ""]


class Verdict(NamedTuple):
    """What the engine is told after each control step."""

    goal_index: Int[jax.Array, ""]
    done: Bool[jax.Array, ""]
    reason: Int[jax.Array, ""]


class Rooms:
    """Deliveries to rooms; passed when all goals were reached."""

    arrived_m = ARRIVED_M

    def place(self, world: "World", floor: "HostMap", hull_radius_m: float, rng: np.random.Generator) -> Placement:
        """Returns the start at the origin, facing any way, and goals drawn so that each lies in another room.

        Raises:
            ValueError: The world has no free floor that the robot can reach from the origin.
        """
        reachable = _reachable(floor, hull_radius_m + _WAY_ROOM_M)
        cells = reachable & (floor.clearance_m >= hull_radius_m + _GOAL_ROOM_M)
        if not cells.any():
            raise ValueError(f"{world.name}: no floor for a robot of {hull_radius_m:.2f} m radius around the origin")
        points = np.column_stack([_points(floor, cells), floor.clearance_m[cells]])
        goals: list[Float64[np.ndarray, 2]] = []
        here = np.zeros(2)
        for _ in range(GOALS):
            here = _draw_goal(world, points, here, rng)
            goals.append(here)
        return Placement(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]), np.stack(goals))

    def init(self, start: Float[jax.Array, "3"], goals_m: Float[jax.Array, "goals 2"]) -> Progress:
        """Returns the progress before the first step."""
        return Progress(goals_m, jnp.zeros((), jnp.int32), start[:2], jnp.zeros(()))

    # The engine's Truth: a bundle depends on nothing of Simyard when it runs.
    def step(self, state: Progress, truth: Any) -> tuple[Progress, Verdict]:  # noqa: ANN401 - see above
        """Returns the progress and the verdict after a control step."""
        place = truth.pose[:2]
        goal = state.goals_m[jnp.minimum(state.reached, GOALS - 1)]
        arrived = jnp.sum((place - goal) ** 2) < ARRIVED_M**2
        reached = state.reached + arrived
        moved = jnp.sum((place - state.anchor_m) ** 2) > STUCK_M**2
        anchored_s = jnp.where(moved | arrived, truth.time_s, state.anchored_s)
        stuck = truth.time_s - anchored_s > STUCK_S
        hit = truth.impulse_ns > HARD_IMPULSE_NS
        passed = reached >= GOALS
        reason = jnp.where(stuck, _STUCK, _PASSED)
        reason = jnp.where(~truth.inside, _OUT_OF_BOUNDS, reason)
        reason = jnp.where(hit, _COLLISION, jnp.where(passed, _PASSED, reason))
        done = passed | stuck | hit | ~truth.inside
        anchor = jnp.where(moved, place, state.anchor_m)
        return Progress(state.goals_m, reached, anchor, anchored_s), Verdict(reached, done, reason)


def scenario(environment: Mapping[str, object]) -> Rooms:  # noqa: ARG001 - the engine calls every scenario so
    """Returns the scenario; it reads no environment variables."""
    return Rooms()


def _reachable(floor: "HostMap", radius_m: float) -> np.ndarray:
    """Returns where a disc of that radius gets to from the origin."""
    parts, _ = cast("tuple[np.ndarray, int]", ndimage.label(floor.clearance_m >= radius_m, structure=np.ones((3, 3))))
    column, row = np.rint(-floor.origin_m / floor.cell_m).astype(int)
    return (parts == parts[row, column]) & (parts > 0)


def _points(floor: "HostMap", cells: np.ndarray) -> Float64[np.ndarray, "points 2"]:
    """Returns the centres of the marked cells."""
    rows, columns = np.nonzero(cells)
    return floor.origin_m.astype(np.float64) + float(floor.cell_m) * np.stack([columns, rows], axis=1)


def _draw_goal(
    world: "World", points: Float64[np.ndarray, "points 3"], here: Float64[np.ndarray, "2"], rng: np.random.Generator
) -> Float64[np.ndarray, "2"]:
    """Returns a roomy point in another room than ``here``; where there is none to go to, a point far away.

    Args:
        world: Its rooms are drawn from, each as likely as the other.
        points: Where a goal may be: (x m, y m, clearance m).
        here: Where the robot comes from.
        rng: Draws the room, then the point.
    """
    rooms = [points[_inside(points, room.floor)] for room in world.rooms if not _inside(here[None], room.floor)[0]]
    rooms = [room for room in rooms if len(room)]
    if rooms:
        candidates = _handy(rooms[int(rng.integers(len(rooms)))], here)
    else:
        distance = np.hypot(*(points[:, :2] - here).T)
        candidates = points[distance >= distance.max() / 2]
    return candidates[int(rng.integers(len(candidates))), :2]


def _handy(points: Float64[np.ndarray, "points 3"], here: Float64[np.ndarray, "2"]) -> Float64[np.ndarray, "points 3"]:
    """Returns where in a room one would put a delivery down: its roomier half, and of that the nearer half."""
    roomy = points[points[:, 2] >= np.median(points[:, 2])]
    distance = np.hypot(*(roomy[:, :2] - here).T)
    return roomy[distance <= np.median(distance)]


def _inside(points: Float64[np.ndarray, "points columns"], floor: "Rectangle") -> np.ndarray:
    x, y = points[:, 0], points[:, 1]
    return (x >= floor.x_min_m) & (x <= floor.x_max_m) & (y >= floor.y_min_m) & (y <= floor.y_max_m)
