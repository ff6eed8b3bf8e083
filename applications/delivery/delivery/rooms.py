"""The delivery scenario: from the start to goals in other rooms, one after the other, without hitting anything."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from scipy import ndimage

if TYPE_CHECKING:
    from specs.data.world import FloorZone, Room, World
    from tasks.simulate.application.contract import HostMap

DEFAULT_GOALS = 2
MOST_GOALS = 100
ARRIVED_M = 0.3
# What stops the courier's 2 kg from 0.1 m/s at once; brushing along a wall stays far below.
HARD_IMPULSE_NS = 0.2
STUCK_S = 10.0
STUCK_M = 0.15
# The hull has this much room on all sides, at a goal and on the way to it.
_ROOM_M = 0.05
# In a world without rooms, goals are at least this far from the place before.
_NEAR_M = 1.0
_PASSED, _COLLISION, _STUCK, _OUT_OF_BOUNDS = 0, 1, 3, 4


class Placement(NamedTuple):
    """Start (x m, y m, yaw rad), goals (x m, y m) in order, and how many they are."""

    start: Float64[np.ndarray, "3"]
    goals_m: Float64[np.ndarray, "goals 2"]
    given: tuple[np.ndarray]


class _Ground(NamedTuple):
    """Where goals may be in a world.

    Attributes:
        clearance_m: Of its map; as long as it is kept, no other array can have its identity.
        start_m: Where the robot gets there from.
        points: The centres of all cells that the robot gets to.
        rooms: Of the world; its zones where it has no rooms.
        within: Each room, and those of the points that lie in it.
    """

    clearance_m: np.ndarray
    rooms: "Sequence[Room] | Sequence[FloorZone]"
    hull_radius_m: float
    start_m: tuple[float, float]
    points: Float64[np.ndarray, "points 2"]
    within: "list[tuple[Room | FloorZone, Float64[np.ndarray, 'points 2']]]"


_GROUNDS_KEPT = 64
_grounds: dict[int, _Ground] = {}


class Progress(NamedTuple):
    """Goals, how many there are and are reached, and since when and where the robot has not got on."""

    goals_m: Float[jax.Array, "goals 2"]
    total: Int[jax.Array, ""]
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

    def __init__(self, goals: "float | Float[jax.Array, ''] | None", route: str | None = None) -> None:
        self._goals, self._route = goals, route

    def place(
        self,
        world: "World",
        floor: "HostMap",
        hull_radius_m: float,
        rng: np.random.Generator,
        shares: "Sequence[tuple[float, float] | None]" = (),
    ) -> Placement:
        """Returns the world's start, and goals: a route's, or drawn so that each lies in another room.

        An imported world's zones are rooms; in a world without any, goals are anywhere within reach. Where the world
        says no start, it is the origin, and the robot faces any way.

        Args:
            world: Where.
            floor: Its map.
            hull_radius_m: The robot's.
            rng: Draws all goals but those that have shares.
            shares: Of the first goals, two numbers between 0 and 1 that say which of its places it is; where they are
                uniform, goals are as likely as those that ``rng`` draws.

        Raises:
            ValueError: GOALS or ROUTE is none that the world has, a route's goals have shares, or the robot can reach
                no floor from the start.
        """
        ground = _ground(world, floor, hull_radius_m)
        if not len(ground.points):
            at = "the origin" if world.start is None else "({:g}, {:g})".format(*ground.start_m)
            raise ValueError(f"{world.name}: no floor for a robot of {hull_radius_m:.2f} m radius around {at}")
        route = None if self._route is None else _route(world, self._route)
        if route is not None and shares:
            raise ValueError(f"ROUTE: {self._route!r}: says what goals there are: no goals.x1_share beside it")
        count = self._count(DEFAULT_GOALS if route is None else len(route))
        goals: list[Float64[np.ndarray, 2]] = list(() if route is None else route[:count])
        here = np.array(ground.start_m)
        while len(goals) < count:
            share = shares[len(goals)] if len(goals) < len(shares) else None
            places = _goal_places(ground, here)
            here = _draw_goal(places, rng) if share is None else _goal_of(places, *share)
            goals.append(here)
        yaw = rng.uniform(-np.pi, np.pi) if world.start is None else world.start.yaw_rad
        return Placement(np.array([*ground.start_m, yaw]), np.stack(goals), (np.array(count, np.int32),))

    def _count(self, most: int) -> int:
        """Returns how many goals are asked for; as many as a route has, where that is what is asked for."""
        goals = float(most if self._goals is None else self._goals)
        most_goals = MOST_GOALS if self._route is None else most
        if round(goals) != goals or not 1 <= goals <= most_goals:
            raise ValueError(f"GOALS: {goals:g}: must be a whole number from 1 to {most_goals}")
        return round(goals)

    def init(
        self, start: Float[jax.Array, "3"], goals_m: Float[jax.Array, "goals 2"], total: Int[jax.Array, ""]
    ) -> Progress:
        """Returns the progress before the first step."""
        return Progress(goals_m, total, jnp.zeros((), jnp.int32), start[:2], jnp.zeros(()))

    # The engine's Truth: a bundle depends on nothing of Simyard when it runs.
    def step(self, state: Progress, truth: Any) -> tuple[Progress, Verdict]:  # noqa: ANN401 - see above
        """Returns the progress and the verdict after a control step."""
        place = truth.pose[:2]
        goal = state.goals_m[jnp.minimum(state.reached, state.total - 1)]
        arrived = jnp.sum((place - goal) ** 2) < ARRIVED_M**2
        reached = state.reached + arrived
        moved = jnp.sum((place - state.anchor_m) ** 2) > STUCK_M**2
        anchored_s = jnp.where(moved | arrived, truth.time_s, state.anchored_s)
        stuck = truth.time_s - anchored_s > STUCK_S
        hit = truth.impulse_ns > HARD_IMPULSE_NS
        passed = reached >= state.total
        reason = jnp.where(stuck, _STUCK, _PASSED)
        reason = jnp.where(~truth.inside, _OUT_OF_BOUNDS, reason)
        reason = jnp.where(hit, _COLLISION, jnp.where(passed, _PASSED, reason))
        done = passed | stuck | hit | ~truth.inside
        anchor = jnp.where(moved, place, state.anchor_m)
        return Progress(state.goals_m, state.total, reached, anchor, anchored_s), Verdict(reached, done, reason)


def scenario(environment: Mapping[str, "str | Float[jax.Array, '']"]) -> Rooms:
    """Returns the scenario; GOALS is the number of goals, ROUTE the name of one of the world's routes.

    Raises:
        ValueError: GOALS is not a number.
    """
    goals, route = environment.get("GOALS"), environment.get("ROUTE")
    if isinstance(goals, str):
        raise ValueError(f"GOALS: {goals!r}: must be a whole number from 1 to {MOST_GOALS}")  # noqa: TRY004 - the text is the wrong value of a variable
    if not isinstance(route, str | None):
        raise ValueError(f"ROUTE: {route}: must be a route's name, which no number is")  # noqa: TRY004 - as above
    return Rooms(goals, route)


def _route(world: "World", name: str) -> "Sequence[Float64[np.ndarray, '2']]":
    """Returns the places of a world's route."""
    routes = {route.name: route.points_m for route in world.routes or ()}
    if name not in routes:
        allowed = " or ".join(sorted(routes)) or "left out: the world has no routes"
        raise ValueError(f"{world.name}: ROUTE: {name!r}: must be {allowed}")
    return [np.array(point) for point in routes[name]]


def _ground(world: "World", floor: "HostMap", hull_radius_m: float) -> _Ground:
    """Returns where goals may be in a world; kept, since many episodes take place in it."""
    key, rooms = id(floor.clearance_m), world.areas
    start_m = (0.0, 0.0) if world.start is None else (world.start.x_m, world.start.y_m)
    kept = _grounds.get(key)
    if kept is None or kept.rooms is not rooms or (kept.hull_radius_m, kept.start_m) != (hull_radius_m, start_m):
        points = _points(floor, _reachable(floor, hull_radius_m + _ROOM_M, start_m))
        within = [(room, points[room.holds(*points.T)]) for room in rooms]
        kept = _Ground(floor.clearance_m, rooms, hull_radius_m, start_m, points, within)
        # A map that can be written to may be another one tomorrow.
        if not floor.clearance_m.flags.writeable:
            _grounds.pop(key, None)
            _grounds[key] = kept
            while len(_grounds) > _GROUNDS_KEPT:
                del _grounds[next(iter(_grounds))]
    return kept


def _reachable(floor: "HostMap", radius_m: float, start_m: tuple[float, float]) -> np.ndarray:
    """Returns where a disc of that radius gets to from the start."""
    parts, _ = cast("tuple[np.ndarray, int]", ndimage.label(floor.clearance_m >= radius_m, structure=np.ones((3, 3))))
    column, row = np.rint((np.array(start_m) - floor.origin_m) / floor.cell_m).astype(int)
    inside = 0 <= row < parts.shape[0] and 0 <= column < parts.shape[1]
    return (parts == parts[row, column]) & (parts > 0) if inside else np.zeros(parts.shape, bool)


def _points(floor: "HostMap", cells: np.ndarray) -> Float64[np.ndarray, "points 2"]:
    """Returns the centres of the marked cells."""
    rows, columns = np.nonzero(cells)
    return floor.origin_m.astype(np.float64) + float(floor.cell_m) * np.stack([columns, rows], axis=1)


def _goal_places(ground: _Ground, here: Float64[np.ndarray, "2"]) -> "list[Float64[np.ndarray, 'points 2']]":
    """Returns the points of each room or zone but that of ``here``; where there is none to go to, points far away.

    In a world without rooms they are all points that are not quite near.

    Args:
        ground: Its rooms are goals, each as likely as the other.
        here: Where the robot comes from.
    """
    rooms = [points for room, points in ground.within if len(points) and not room.holds(*here[:, None])[0]]
    if rooms:
        return rooms
    distance = np.hypot(*(ground.points - here).T)
    least_m = distance.max() / 2
    return [ground.points[distance >= (least_m if ground.rooms else min(least_m, _NEAR_M))]]


def _draw_goal(
    places: "Sequence[Float64[np.ndarray, 'points 2']]", rng: np.random.Generator
) -> Float64[np.ndarray, "2"]:
    """Returns a point of a room, each room as likely as the other, and each of its points."""
    points = places[int(rng.integers(len(places)))]
    return points[int(rng.integers(len(points)))]


def _goal_of(
    places: "Sequence[Float64[np.ndarray, 'points 2']]", x_share: float, y_share: float
) -> Float64[np.ndarray, "2"]:
    """Returns the point of two shares: one of all rooms, and within it of its points by their x, the other of a column.

    As likely as those that are drawn where both are uniform; a little more of a share is a little further.
    """
    room = _share_of(x_share, len(places))
    points = places[room]
    x_m = np.sort(points[:, 0])[_share_of(x_share * len(places) - room, len(points))]
    column = points[points[:, 0] == x_m]
    return column[_share_of(y_share, len(column))]


def _share_of(share: float, count: int) -> int:
    return min(int(share * count), count - 1)
