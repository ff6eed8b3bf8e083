"""Glides down the map's travel costs in any direction, and turns its front to where it goes while it does."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

RADIUS_M, COMFORT_M, CROWDED, SLACK_M = 0.22, 0.45, 6.0, 0.05
SLOW_M, TURN_GAIN, MOST_TURN_RAD_S = 0.35, 1.5, 1.5
CELLS = tuple((row, column) for row in (-2, -1, 0, 1, 2) for column in (-2, -1, 0, 1, 2))


class Lidar(NamedTuple):
    rays: int = 24
    range_m: float = 5.0
    height_m: float = 0.15


class Costs(NamedTuple):
    """What the way from each cell to each goal costs, on the map's grid."""

    cost: jax.Array
    origin_m: jax.Array
    cell_m: jax.Array


class Glide:
    lidar = Lidar()

    def __init__(self, most_m_s):
        self._most_m_s = most_m_s

    def init(self, floor, goals_m):
        return travel_costs(floor, goals_m)

    def step(self, state, observation):
        place, yaw = observation.pose[:2], observation.pose[2]
        way = downhill(state, observation.goal_index, place, observation.goal_m) - place
        length = jnp.sqrt(jnp.sum(way**2)) + 1e-6
        cos, sin = jnp.cos(yaw), jnp.sin(yaw)
        ahead, left = cos * way[0] + sin * way[1], cos * way[1] - sin * way[0]
        # Ideal lidar: the nearest solid all around says how careful to be.
        room = jnp.clip((observation.ranges_m.min() - RADIUS_M) / SLOW_M, 0.15, 1.0)
        speed = jnp.minimum(self._most_m_s * room, 2.0 * length)
        turn = jnp.clip(TURN_GAIN * jnp.arctan2(left, ahead), -MOST_TURN_RAD_S, MOST_TURN_RAD_S)
        return state, jnp.stack([speed * ahead / length, speed * left / length, turn])


def travel_costs(floor, goals_m):
    """Returns what ways cost: the costs spread from the goals along rows and columns until nothing changes."""
    crowded = jnp.clip((COMFORT_M - floor.clearance_m) / (COMFORT_M - RADIUS_M), 0.0, 2.0)
    price = jnp.where(floor.clearance_m > RADIUS_M - SLACK_M, 1.0 + CROWDED * crowded**2, jnp.inf)
    column, row = jnp.round((goals_m - floor.origin_m) / floor.cell_m).astype(int).T
    start = jnp.full((len(goals_m), *price.shape), jnp.inf).at[jnp.arange(len(goals_m)), row, column].set(0.0)

    def relaxed(cost):
        for axis in (1, 2):
            for shift in (1, -1):
                cost = jnp.minimum(cost, jnp.roll(cost, shift, axis) + price)
        return cost

    def unsettled(both):
        return jnp.any(both[0] != both[1])

    both = jax.lax.while_loop(unsettled, lambda both: (both[1], relaxed(both[1])), (start, relaxed(start)))
    return Costs(both[0], floor.origin_m, floor.cell_m)


def downhill(costs, goal, place_m, goal_m):
    """Returns the cheapest point within two cells of a place; the goal itself when it is as near."""
    column, row = jnp.round((place_m - costs.origin_m) / costs.cell_m).astype(int)
    rows = jnp.clip(row + jnp.asarray([up for up, _ in CELLS]), 0, costs.cost.shape[1] - 1)
    columns = jnp.clip(column + jnp.asarray([along for _, along in CELLS]), 0, costs.cost.shape[2] - 1)
    best = jnp.argmin(costs.cost[goal, rows, columns])
    near = jnp.sum((goal_m - place_m) ** 2) < (2.0 * costs.cell_m) ** 2
    return jnp.where(near, goal_m, costs.origin_m + costs.cell_m * jnp.stack([columns[best], rows[best]]))


def controller(environment):
    return Glide(environment.get("MAX_SPEED", 0.5))
