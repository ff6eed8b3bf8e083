"""The coverage scenario: from the start, see all the floor that the robot gets to, without hitting anything."""

import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int16, UInt32
from scipy import ndimage

from .sight import MOST_SQUARES, WORD_BITS, Squares, packed, sights, squares_of
from .tour import tour

if TYPE_CHECKING:
    from specs.data.world import World
    from tasks.simulate.application.contract import HostMap

Number = float | Float[jax.Array, ""]
DEFAULT_RANGE_M = 2.5
DEFAULT_SHARE = 0.95
ARRIVED_M = 0.3
# As in delivery: what stops 2 kg from 0.1 m/s at once.
HARD_IMPULSE_NS = 0.2
STUCK_S = 10.0
STUCK_M = 0.15
# A viewpoint that shows no more than this many squares of what was not seen is passed over.
_NOT_WORTH_SQUARES = 2
# Viewpoints are as many as a multiple of this: worlds then share a program.
_VIEWPOINTS_TOGETHER = 4
_CHARTS_KEPT = 64
_ROOM_M = 0.05
_PASSED, _COLLISION, _STUCK, _OUT_OF_BOUNDS = 0, 1, 3, 4


class Chart(NamedTuple):
    """What a scenario needs of a world while it runs.

    Attributes:
        sights: Which squares are seen from each square, in words of 32.
        number: Which square is at each row and column of squares; -1 for none.
        grid: The map's first cell's centre (x m, y m), and the side of a square (m).
        squares: How many squares there are to see.
        viewpoints: How many goals are the episode's own.
        floor_m2: How much floor that is.
    """

    sights: UInt32[np.ndarray | jax.Array, "squares words"]
    number: Int16[np.ndarray | jax.Array, "rows columns"]
    grid: Float32[np.ndarray | jax.Array, "3"]
    squares: Int[np.ndarray | jax.Array, ""]
    viewpoints: Int[np.ndarray | jax.Array, ""]
    floor_m2: Float32[np.ndarray | jax.Array, ""]


class Placement(NamedTuple):
    """Start (x m, y m, yaw rad), viewpoints (x m, y m) in order, and the world's chart."""

    start: Float64[np.ndarray, "3"]
    goals_m: Float64[np.ndarray, "goals 2"]
    given: tuple[np.ndarray, ...]


class Progress(NamedTuple):
    """What was seen and when, which viewpoints are done with, and since when and where the robot has not got on."""

    chart: Chart
    goals_m: Float[jax.Array, "goals 2"]
    seen: UInt32[jax.Array, "words"]
    half_s: Float[jax.Array, ""]
    most_s: Float[jax.Array, ""]
    reached: Int[jax.Array, ""]
    anchor_m: Float[jax.Array, "2"]
    anchored_s: Float[jax.Array, ""]


class Verdict(NamedTuple):
    """What the engine is told after each control step."""

    goal_index: Int[jax.Array, ""]
    done: Bool[jax.Array, ""]
    reason: Int[jax.Array, ""]


class Floor:
    """Seeing the floor; passed when SHARE of it was within RANGE and in sight. Its goals are no destinations."""

    arrived_m = None

    def __init__(self, range_m: Number, share: Number) -> None:
        self._range_m, self._share = range_m, share

    def place(self, world: "World", floor: "HostMap", hull_radius_m: float, rng: np.random.Generator) -> Placement:
        """Returns the world's start, and a tour of viewpoints that show the floor.

        Where the world says no start, it is the origin, and the robot faces any way.

        Raises:
            ValueError: RANGE or SHARE is out of bounds, or the robot can reach no floor from the start.
        """
        range_m, share = float(self._range_m), float(self._share)
        if not 0.5 <= range_m <= 100.0:
            raise ValueError(f"RANGE: {range_m:g}: must be a number of metres from 0.5 to 100")
        if not 0.0 < share <= 1.0:
            raise ValueError(f"SHARE: {share:g}: must be above 0 and at most 1")
        arrays = tuple((each.tobytes(), each.shape) for each in floor)
        start_m = (0.0, 0.0) if world.start is None else (world.start.x_m, world.start.y_m)
        found = _charted(arrays, hull_radius_m, range_m, start_m)
        if found is None:
            at = "the origin" if world.start is None else "({:g}, {:g})".format(*start_m)
            raise ValueError(f"{world.name}: no floor for a robot of {hull_radius_m:.2f} m radius around {at}")
        goals_m, chart = found
        yaw = rng.uniform(-np.pi, np.pi) if world.start is None else world.start.yaw_rad
        return Placement(np.array([*start_m, yaw]), goals_m, cast("tuple[np.ndarray, ...]", tuple(chart)))

    def init(self, start: Float[jax.Array, "3"], goals_m: Float[jax.Array, "goals 2"], *given: jax.Array) -> Progress:
        """Returns the progress before the first step, when nothing was seen."""
        seen, never = jnp.zeros(MOST_SQUARES // WORD_BITS, jnp.uint32), jnp.full((), jnp.nan)
        return Progress(Chart(*given), goals_m, seen, never, never, jnp.zeros((), jnp.int32), start[:2], jnp.zeros(()))

    # The engine's Truth: a bundle depends on nothing of Simyard when it runs.
    def step(self, state: Progress, truth: Any) -> tuple[Progress, Verdict]:  # noqa: ANN401 - see above
        """Returns the progress and the verdict after a control step."""
        chart, place = state.chart, truth.pose[:2]
        seen = state.seen | _sight(chart, place)
        share = _count(seen) / chart.squares
        passed = share >= self._share
        reached = jnp.minimum(state.reached + _done_with(state, seen, place), chart.viewpoints)
        moved = jnp.sum((place - state.anchor_m) ** 2) > STUCK_M**2
        anchored_s = jnp.where(moved, truth.time_s, state.anchored_s)
        stuck = truth.time_s - anchored_s > STUCK_S
        hit = truth.impulse_ns > HARD_IMPULSE_NS
        reason = jnp.where(stuck, _STUCK, _PASSED)
        reason = jnp.where(~truth.inside, _OUT_OF_BOUNDS, reason)
        reason = jnp.where(hit, _COLLISION, jnp.where(passed, _PASSED, reason))
        progress = state._replace(
            seen=seen,
            half_s=_first(state.half_s, share >= 0.5, truth.time_s),
            most_s=_first(state.most_s, share >= 0.9, truth.time_s),
            reached=reached,
            anchor_m=jnp.where(moved, place, state.anchor_m),
            anchored_s=anchored_s,
        )
        return progress, Verdict(reached, passed | stuck | hit | ~truth.inside, reason)

    def metrics(self, state: Progress) -> dict[str, Float[jax.Array, ""]]:
        """Returns how much was seen, and when half and nine tenths of it were; no time for what was not."""
        share = _count(state.seen) / state.chart.squares
        return {
            "covered_share": share,
            "covered_m2": share * state.chart.floor_m2,
            "time_to_50_percent_s": state.half_s,
            "time_to_90_percent_s": state.most_s,
        }


def scenario(environment: Mapping[str, str | Number]) -> Floor:
    """Returns the scenario; RANGE is how far the robot sees (m), SHARE how much of the floor it must see.

    Raises:
        ValueError: One of them is not a number.
    """
    return Floor(_number(environment, "RANGE", DEFAULT_RANGE_M), _number(environment, "SHARE", DEFAULT_SHARE))


def _number(environment: Mapping[str, str | Number], name: str, default: float) -> Number:
    value = environment.get(name, default)
    if isinstance(value, str):
        raise ValueError(f"{name}: {value!r}: must be a number")  # noqa: TRY004 - the text is the wrong value of a variable
    return value


def _sight(chart: Chart, place: Float[jax.Array, "2"]) -> UInt32[jax.Array, "words"]:
    """Returns the squares that are seen from a place."""
    rows, columns = chart.number.shape
    # Cells are centred on whole numbers, squares begin with their first cell's edge.
    column_row = jnp.floor((place - chart.grid[:2]) / chart.grid[2]).astype(jnp.int32)
    square = chart.number[jnp.clip(column_row[1], 0, rows - 1), jnp.clip(column_row[0], 0, columns - 1)]
    return jnp.where(square >= 0, chart.sights[square], jnp.uint32(0))


def _done_with(state: Progress, seen: UInt32[jax.Array, "words"], place: Float[jax.Array, "2"]) -> Bool[jax.Array, ""]:
    """Returns whether the current viewpoint was reached, or would show next to nothing new."""
    goal_m = state.goals_m[jnp.minimum(state.reached, state.goals_m.shape[0] - 1)]
    arrived = jnp.sum((place - goal_m) ** 2) < ARRIVED_M**2
    return arrived | (_count(_sight(state.chart, goal_m) & ~seen) <= _NOT_WORTH_SQUARES)


def _count(words: UInt32[jax.Array, "words"]) -> Int[jax.Array, ""]:
    return jnp.sum(jax.lax.population_count(words)).astype(jnp.int32)


def _first(before_s: Float[jax.Array, ""], now: Bool[jax.Array, ""], time_s: Float[jax.Array, ""]) -> jax.Array:
    return jnp.where(jnp.isnan(before_s) & now, time_s, before_s)


@functools.lru_cache(maxsize=_CHARTS_KEPT)
def _charted(
    arrays: tuple[tuple[bytes, tuple[int, ...]], ...], radius_m: float, range_m: float, start_m: tuple[float, float]
) -> tuple[Float64[np.ndarray, "goals 2"], Chart] | None:
    """Returns viewpoints and chart of a world, given its map's arrays; kept, since they are the same for all seeds."""
    clearance_m, origin_m, cell_m, bounds_m = (np.frombuffer(raw, np.float32).reshape(shape) for raw, shape in arrays)
    floor = cast("HostMap", _Map(clearance_m, origin_m, cell_m, bounds_m))
    reachable = _reachable(floor, radius_m + _ROOM_M, start_m)
    if not reachable.any():
        return None
    squares = squares_of(floor, reachable)
    seen = sights(floor, squares.points_m, range_m)
    start = int(np.argmin(np.hypot(*(squares.points_m - start_m).T)))
    goals_m = squares.points_m[tour(squares, seen, start, radius_m)]
    more = -len(goals_m) % _VIEWPOINTS_TOGETHER
    goals_m = np.concatenate([goals_m, np.repeat(goals_m[-1:], more, axis=0)])
    return goals_m, _chart(floor, squares, packed(seen), len(goals_m), int(np.count_nonzero(reachable)))


class _Map(NamedTuple):
    """A HostMap, made from its arrays."""

    clearance_m: Float32[np.ndarray, "rows columns"]
    origin_m: Float32[np.ndarray, "2"]
    cell_m: Float32[np.ndarray, ""]
    bounds_m: Float32[np.ndarray, "4"]


def _chart(floor: "HostMap", squares: Squares, sights: np.ndarray, viewpoints: int, cells: int) -> Chart:
    cell_m = float(floor.cell_m)
    corner = floor.origin_m - cell_m / 2
    return Chart(
        sights,
        squares.number,
        np.array([*corner, squares.side_cells * cell_m], np.float32),
        np.array(len(squares.points_m), np.int32),
        np.array(viewpoints, np.int32),
        np.array(cells * cell_m**2, np.float32),
    )


def _reachable(floor: "HostMap", radius_m: float, start_m: tuple[float, float]) -> Bool[np.ndarray, "rows columns"]:
    """Returns where a disc of that radius gets to from the start."""
    parts, _ = cast("tuple[np.ndarray, int]", ndimage.label(floor.clearance_m >= radius_m, structure=np.ones((3, 3))))
    column, row = np.rint((np.array(start_m) - floor.origin_m) / floor.cell_m).astype(int)
    inside = 0 <= row < parts.shape[0] and 0 <= column < parts.shape[1]
    return (parts == parts[row, column]) & (parts > 0) if inside else np.zeros(parts.shape, bool)
