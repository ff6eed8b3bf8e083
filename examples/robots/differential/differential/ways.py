"""The way to each goal on the floor map: for each cell its neighbour on the cheapest way, dearer near solids."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

COMFORT_M, CROWDED, SLACK_M, CELLS_AHEAD = 0.45, 6.0, 0.05, 4
MOVES = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))


class Ways(NamedTuple):
    """For each goal and cell the row and the column of the next cell, which is its own where no way leads on."""

    row: jax.Array
    column: jax.Array
    origin_m: jax.Array
    cell_m: jax.Array


def ways_to_goals(floor, goals_m, radius_m):
    """Returns the cheapest ways: costs spread from the goals, a cell a round, until nothing changes."""
    rows, columns = floor.clearance_m.shape
    crowded = jnp.clip((COMFORT_M - floor.clearance_m) / (COMFORT_M - radius_m), 0.0, 2.0)
    price = jnp.where(floor.clearance_m > radius_m - SLACK_M, 1.0 + CROWDED * crowded**2, jnp.inf)
    column, row = jnp.round((goals_m - floor.origin_m) / floor.cell_m).astype(int).T
    cost = jnp.full((len(goals_m), rows, columns), jnp.inf).at[jnp.arange(len(goals_m)), row, column].set(0.0)

    def by_moves(cost):
        wide = jnp.pad(cost, ((0, 0), (1, 1), (1, 1)), constant_values=jnp.inf)
        ways = [
            wide[:, 1 + up : 1 + up + rows, 1 + to : 1 + to + columns] + (up**2 + to**2) ** 0.5 * price
            for up, to in MOVES
        ]
        return jnp.stack([cost, *ways])

    def unsettled(both):
        return jnp.any(both[0] != both[1])

    settled = jax.lax.while_loop(
        unsettled, lambda both: (both[1], by_moves(both[1]).min(0)), (cost, by_moves(cost).min(0))
    )
    best = jnp.argmin(by_moves(settled[0])[1:], axis=0)
    stays = (settled[0] == 0.0) | ~jnp.isfinite(settled[0])
    rise, run = (jnp.where(stays, 0, jnp.asarray([move[k] for move in MOVES])[best]) for k in (0, 1))
    return Ways(jnp.arange(rows)[:, None] + rise, jnp.arange(columns) + run, floor.origin_m, floor.cell_m)


def point_ahead(ways, goal, place_m, goal_m):
    """Returns the point some cells ahead on the way to a goal; the goal itself when it is that near."""
    column, row = jnp.round((place_m - ways.origin_m) / ways.cell_m).astype(int)
    row, column = jnp.clip(row, 0, ways.row.shape[1] - 1), jnp.clip(column, 0, ways.row.shape[2] - 1)
    for _ in range(CELLS_AHEAD):
        row, column = ways.row[goal, row, column], ways.column[goal, row, column]
    near = jnp.sum((goal_m - place_m) ** 2) < (CELLS_AHEAD * ways.cell_m) ** 2
    return jnp.where(near, goal_m, ways.origin_m + ways.cell_m * jnp.stack([column, row]))
