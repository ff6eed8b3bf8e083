"""The ways to all goals on the floor map: in each cell, which of its neighbours is next.

Costs are found by sweeping over rows and columns in both directions until nothing changes (H. Zhao, fast sweeping,
2005), each line relaxed from the one before it. Lines of a robot's goals are relaxed together, and only those within
its world's walls.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int, UInt8

if TYPE_CHECKING:
    from tasks.simulate.application.contract import FloorMap

RADIUS_M = 0.18
# The map's cells are 0.1 m wide, in worlds of more than 51 m wider: the robot may stand, touching nothing, where the
# cell's centre has this much less.
_LEAST_CELL_M = 0.1
_CELL_SLACK_M = 0.05
# Closer to solids than this, a cell costs more, up to _CROWDED times as much where the hull just fits.
_COMFORT_M = 0.4
_CROWDED = 6.0
# A gap that leaves the hull less than this on both sides costs so much that any other way is taken: a robot that turns
# in it touches, and turns on the spot until it is stuck. It is no wall, as the map may be off by half a cell.
_TIGHT_M = RADIUS_M + 0.01
_TIGHT = 100.0
_DIAGONAL = 2.0**0.5
# Fields at a time: those of a robot with two goals. More wait for the last of them, and leave the core's nearest cache:
# with 8 it takes 1.1 to 1.9 times as long on maps of 128 cells a side.
_FIELDS_TOGETHER = 2
_NEIGHBOURS = tuple((row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column)
_HERE = len(_NEIGHBOURS)
# Lines first, then robots and goals, so that neighbouring lines are slices.
Fields = Float[jax.Array, "lines fields cells"]
Sweep = tuple[Fields, Float[jax.Array, "fields cells"]]


class Grid(Protocol):
    """Where the cells of a grid are, as a map has them."""

    @property
    def origin_m(self) -> Float[jax.Array, "2"]:
        """Returns the middle of its first cell."""
        ...

    @property
    def cell_m(self) -> Float[jax.Array, ""]:
        """Returns the side of a cell."""
        ...


class Ways(NamedTuple):
    """The next cell on the way to each goal, from each cell.

    Attributes:
        next_cell: Index in the eight neighbours; 8 at the goal, and where no way leads.
        origin_m, cell_m: The grid, as the map's.
    """

    next_cell: UInt8[jax.Array, "goals rows columns"]
    origin_m: Float[jax.Array, "2"]
    cell_m: Float[jax.Array, ""]


def ways_to_goals(floor: "FloorMap", goals_m: Float[jax.Array, "goals 2"]) -> Ways:
    """Returns the best ways to each goal, in cells that are far from anything."""
    return Ways(_next_cells(floor, goals_m), floor.origin_m, floor.cell_m)


def point_ahead(ways: Ways, goal: Int[jax.Array, ""], start_m: Float[jax.Array, "2"], ahead_m: float) -> jax.Array:
    """Returns the point (x m, y m) that far on the way to a goal, in whole cells; the goal's cell if that is nearer."""
    steps = jnp.asarray([*_NEIGHBOURS, (0, 0)], jnp.int32)
    cell = jnp.stack(cell_of(ways, ways.next_cell.shape[1:], start_m))
    for number in range(1, 1 + round(ahead_m / _LEAST_CELL_M)):
        further = number * ways.cell_m <= ahead_m + _CELL_SLACK_M / 2
        cell = cell + jnp.where(further, steps[ways.next_cell[goal, cell[0], cell[1]]], 0)
    return ways.origin_m + ways.cell_m * cell[::-1].astype(jnp.float32)


def cell_of(grid: Grid, shape: Sequence[int], point_m: Float[jax.Array, "*each 2"]) -> tuple[jax.Array, jax.Array]:
    """Returns the (row, column) of the cell that holds a point, clipped to a grid of that shape."""
    column_row = jnp.round((point_m - grid.origin_m) / grid.cell_m).astype(jnp.int32)
    return jnp.clip(column_row[..., 1], 0, shape[0] - 1), jnp.clip(column_row[..., 0], 0, shape[1] - 1)


def cell_weight(clearance_m: Float[jax.Array, "*each"]) -> Float[jax.Array, "*each"]:
    """Returns what it costs to cross cells: 1 in the open, more near solids, infinite where the hull hits.

    Between the two, gaps that are as wide as the hull are a last resort.
    """
    room = (_COMFORT_M - clearance_m) / (_COMFORT_M - RADIUS_M)
    weight = 1.0 + (_CROWDED - 1.0) * jnp.clip(room, 0.0, 2.0) ** 2
    weight = jnp.where(clearance_m < _TIGHT_M, _TIGHT, weight)
    return jnp.where(clearance_m >= RADIUS_M - _CELL_SLACK_M, weight, jnp.inf)


@jax.custom_batching.custom_vmap
def _next_cells(floor: "FloorMap", goals_m: Float[jax.Array, "goals 2"]) -> UInt8[jax.Array, "goals rows columns"]:
    return _next_of_some(jax.tree.map(lambda array: array[None], floor), goals_m[None])[0]


@_next_cells.def_vmap
def _next_of_lanes(lanes: int, mapped: Sequence[Any], floor: "FloorMap", goals_m: jax.Array) -> tuple[jax.Array, bool]:
    """Returns the next cells of many robots; on a CPU a few at a time, which fit its cache."""

    def repeated(array: jax.Array, is_mapped: bool) -> jax.Array:  # noqa: FBT001 - JAX's own form
        return array if is_mapped else jnp.broadcast_to(array, (lanes, *array.shape))

    on_cpu = jax.default_backend() == "cpu"
    together = math.gcd(lanes, max(1, _FIELDS_TOGETHER // goals_m.shape[-2])) if on_cpu else lanes
    each = jax.tree.map(repeated, (floor, goals_m), tuple(mapped))
    parts = jax.tree.map(lambda array: array.reshape(lanes // together, together, *array.shape[1:]), each)
    found = jax.lax.map(lambda part: _next_of_some(*part), parts)
    return found.reshape(lanes, *found.shape[2:]), True


def _next_of_some(
    floors: "FloorMap", goals_m: Float[jax.Array, "lanes goals 2"]
) -> UInt8[jax.Array, "lanes goals rows columns"]:
    """Returns the next cells of a few robots; their maps have the robots in front."""
    lanes, goals = goals_m.shape[:2]
    rows, columns = floors.clearance_m.shape[1:]
    across = jnp.moveaxis(floors.clearance_m, 0, 1)
    weight = jnp.repeat(cell_weight(across), goals, axis=1)
    place = jax.vmap(lambda floor, goal_m: cell_of(floor, (rows, columns), goal_m))(floors, goals_m)
    row, column = (each.reshape(-1) for each in place)
    at_goals = jnp.full(weight.shape, jnp.inf).at[row, jnp.arange(lanes * goals), column].set(0.0)
    cost = _swept_until_settled(at_goals, weight)
    onwards = _cheapest(cost, weight, jnp.where(cost > 0.0, jnp.inf, 0.0))
    outwards = jnp.repeat(_cheapest(-across, jnp.zeros(()), -across), goals, axis=1)
    chosen = jnp.where(jnp.isfinite(weight), onwards, outwards)
    return jnp.moveaxis(chosen, 1, 0).reshape(lanes, goals, rows, columns)


def _swept_until_settled(cost: Fields, weight: Fields) -> Fields:
    """Returns the cost of the best way from each cell; infinite where there is none."""
    turned = weight.swapaxes(0, 2)
    spans = [_span(jnp.isfinite(each)) for each in (weight, turned)]

    def sweep_all(
        carry: tuple[Fields, Bool[jax.Array, ""]],
    ) -> tuple[Fields, Bool[jax.Array, ""]]:
        before, _ = carry
        cost = _swept_both_ways(before, weight, spans[0])
        cost = _swept_both_ways(cost.swapaxes(0, 2), turned, spans[1]).swapaxes(0, 2)
        return cost, jnp.any(cost < before)

    return jax.lax.while_loop(lambda carry: carry[1], sweep_all, (cost, jnp.ones((), bool)))[0]


def _span(free: Bool[jax.Array, "lines fields cells"]) -> tuple[jax.Array, jax.Array]:
    """Returns the first line that has a free cell, and the one after the last."""
    lines = jnp.any(free, axis=(1, 2))
    return jnp.argmax(lines), lines.shape[0] - jnp.argmax(lines[::-1])


def _swept_both_ways(cost: Fields, weight: Fields, span: tuple[jax.Array, jax.Array]) -> Fields:
    """Returns the costs with each line improved from the line before it, one way and back."""
    first, end = span

    def relax(line: jax.Array, carry: Sweep) -> Sweep:
        cost, previous = carry
        crossing = jax.lax.dynamic_index_in_dim(weight, line, keepdims=False)
        known = jax.lax.dynamic_index_in_dim(cost, line, keepdims=False)
        wide = jnp.pad(previous, ((0, 0), (1, 1)), constant_values=jnp.inf)
        diagonal = _least(wide[:, :-2], wide[:, 2:]) + _DIAGONAL * crossing
        best = _least(known, _least(previous + crossing, diagonal))
        return jax.lax.dynamic_update_index_in_dim(cost, best, line, 0), best

    def relax_back(count: jax.Array, carry: Sweep) -> Sweep:
        return relax(first + end - 1 - count, carry)

    outside = jnp.full(cost.shape[1:], jnp.inf)
    cost, _ = jax.lax.fori_loop(first, end, relax, (cost, outside))
    return jax.lax.fori_loop(first, end, relax_back, (cost, outside))[0]


def _cheapest(cost: Fields, step: Float[jax.Array, "..."], least: Fields) -> UInt8[jax.Array, "lines fields cells"]:
    """Returns the index of the neighbour that each cell is cheapest left by; 8 where none costs less than ``least``.

    Args:
        cost: What is still to be paid from a cell.
        step: What it costs to leave one along the grid.
        least: What the best neighbour must come below.
    """
    chosen = jnp.full(cost.shape, _HERE, jnp.uint8)
    for number, (beside, (row, cell)) in enumerate(zip(_around(cost), _NEIGHBOURS, strict=True)):
        through = beside + (_DIAGONAL * step if row and cell else step)
        chosen = jnp.where(through < least, jnp.uint8(number), chosen)
        least = _least(least, through)
    return chosen


def _around(cost: Fields) -> list[Fields]:
    """Returns for each cell what its neighbours cost, one neighbour after the other."""
    lines, _, cells = cost.shape
    wide = jnp.pad(cost, ((1, 1), (0, 0), (1, 1)), constant_values=jnp.inf)
    return [wide[1 + row : 1 + row + lines, :, 1 + cell : 1 + cell + cells] for row, cell in _NEIGHBOURS]


def _least(one: jax.Array, other: jax.Array) -> jax.Array:
    """Returns the smaller numbers: ``minimum`` would look for NaN, too, and there is none."""
    return jnp.where(one < other, one, other)
