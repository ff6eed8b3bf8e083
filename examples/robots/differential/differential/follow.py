"""Follows the way on the map with two wheels: turns towards a point ahead, and drives as far as it faces it."""

from typing import NamedTuple

import jax.numpy as jnp

from .ways import point_ahead, ways_to_goals

RADIUS_M, HALF_TRACK_M = 0.2, 0.15
TURN_GAIN, MOST_TURN_RAD_S = 3.0, 2.0
BRAKE_M_S2, GAP_M, CREEP_M_S = 0.8, 0.05, 0.05


class Lidar(NamedTuple):
    rays: int = 9
    range_m: float = 5.0
    height_m: float = 0.15
    fov_rad: float = 1.6


class Follow:
    lidar = Lidar()

    def __init__(self, most_m_s):
        self._most_m_s = most_m_s

    def init(self, floor, goals_m):
        return ways_to_goals(floor, goals_m, RADIUS_M)

    def step(self, state, observation):
        x, y, yaw = observation.pose
        target = point_ahead(state, observation.goal_index, observation.pose[:2], observation.goal_m)
        error = jnp.arctan2(target[1] - y, target[0] - x) - yaw
        error = jnp.arctan2(jnp.sin(error), jnp.cos(error))
        free_m = jnp.maximum(observation.ranges_m.min() - RADIUS_M - GAP_M, 0.0)
        most = jnp.minimum(self._most_m_s, jnp.maximum(jnp.sqrt(2.0 * BRAKE_M_S2 * free_m), CREEP_M_S))
        forward = most * jnp.maximum(jnp.cos(error), 0.0) ** 2
        turn = jnp.clip(TURN_GAIN * error, -MOST_TURN_RAD_S, MOST_TURN_RAD_S)
        left, right = forward - HALF_TRACK_M * turn, forward + HALF_TRACK_M * turn
        return state, jnp.stack([left, right, jnp.zeros_like(left)])


def controller(environment):
    return Follow(environment.get("MAX_SPEED", 0.5))
