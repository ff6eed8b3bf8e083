"""The way to a goal on the floor map: a field of costs that falls towards the goal everywhere."""

from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

if TYPE_CHECKING:
    from tasks.simulate.contract import FloorMap

RADIUS_M = 0.18
# The map's cells are 0.1 m wide: the robot may stand, touching nothing, where the cell's centre has this much less.
_CELL_SLACK_M = 0.05
# Closer to solids than this, a cell costs more, up to _CROWDED times as much where the hull just fits.
_COMFORT_M = 0.4
_CROWDED = 6.0
_DIAGONAL = 2.0**0.5
# A cell from which no goal is reached costs this, so that differences stay finite.
_UNREACHED = 1e6
_NEIGHBOURS = tuple((row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column)
Grid = Float[jax.Array, "rows columns"]


def cost_to_goal(floor: "FloorMap", goal_m: Float[jax.Array, "2"]) -> Grid:
    """Returns for each cell the cost of the best way to the goal, in cells that are far from anything.

    Sweeps over rows and columns in both directions until nothing changes (H. Zhao, fast sweeping, 2005), each line
    relaxed from the one before it.
    """
    weight = cell_weight(floor)
    row, column = cell_of(floor, goal_m)
    at_goal = jnp.full(weight.shape, jnp.inf).at[row, column].set(0.0)

    def sweep_all(carry: tuple[Grid, Bool[jax.Array, ""]]) -> tuple[Grid, Bool[jax.Array, ""]]:
        before, _ = carry
        cost = _swept(_swept(before, weight, reverse=False), weight, reverse=True).T
        cost = _swept(_swept(cost, weight.T, reverse=False), weight.T, reverse=True).T
        return cost, jnp.any(cost < before)

    cost, _ = jax.lax.while_loop(lambda carry: carry[1], sweep_all, (at_goal, jnp.ones((), bool)))
    return jnp.where(jnp.isfinite(cost), cost, _UNREACHED)


def cell_weight(floor: "FloorMap") -> Grid:
    """Returns what it costs to cross each cell: 1 in the open, more near solids, infinite where the hull hits."""
    room = (_COMFORT_M - floor.clearance_m) / (_COMFORT_M - RADIUS_M)
    weight = 1.0 + (_CROWDED - 1.0) * jnp.clip(room, 0.0, 2.0) ** 2
    return jnp.where(floor.clearance_m >= RADIUS_M - _CELL_SLACK_M, weight, jnp.inf)


def cell_of(floor: "FloorMap", point_m: Float[jax.Array, "2"]) -> tuple[jax.Array, jax.Array]:
    """Returns the (row, column) of the cell that holds a point, clipped to the map."""
    column_row = jnp.round((point_m - floor.origin_m) / floor.cell_m).astype(jnp.int32)
    rows, columns = floor.clearance_m.shape
    return jnp.clip(column_row[1], 0, rows - 1), jnp.clip(column_row[0], 0, columns - 1)


def point_ahead(floor: "FloorMap", cost: Grid, start_m: Float[jax.Array, "2"], cells: int) -> Float[jax.Array, "2"]:
    """Returns the point that many cells down the cost field from the start; the goal's cell if that is nearer."""
    rows, columns = cost.shape
    steps = jnp.asarray(_NEIGHBOURS)

    def downhill(cell: jax.Array, _: None) -> tuple[jax.Array, None]:
        around = jnp.clip(cell + steps, 0, jnp.asarray([rows - 1, columns - 1]))
        costs = cost[around[:, 0], around[:, 1]]
        best = jnp.argmin(costs)
        return jnp.where(costs[best] < cost[cell[0], cell[1]], around[best], cell), None

    cell, _ = jax.lax.scan(downhill, jnp.stack(cell_of(floor, start_m)), None, length=cells)
    return floor.origin_m + floor.cell_m * cell[::-1].astype(jnp.float32)


def _swept(cost: Grid, weight: Grid, *, reverse: bool) -> Grid:
    """Returns the costs with each line improved from the line before it, in one direction."""
    line = jnp.full(cost.shape[1], jnp.inf)

    def relax(previous: Float[jax.Array, "columns"], lines: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        known, crossing = lines
        wide = jnp.pad(previous, 1, constant_values=jnp.inf)
        straight = previous + crossing
        diagonal = jnp.minimum(wide[:-2], wide[2:]) + _DIAGONAL * crossing
        best = jnp.minimum(known, jnp.minimum(straight, diagonal))
        best = jnp.where(jnp.isfinite(crossing), best, jnp.inf)
        return best, best

    return jax.lax.scan(relax, line, (cost, weight), reverse=reverse)[1]
