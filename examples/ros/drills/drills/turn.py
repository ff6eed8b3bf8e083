"""A drill: the robot turns in place, TURNS times round, and touches nothing."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

HARD_IMPULSE_NS = 0.1
COLLISION, OUT_OF_BOUNDS = 1, 4


class Placement(NamedTuple):
    start: np.ndarray
    goals_m: np.ndarray


class Turned(NamedTuple):
    yaw_rad: object
    turned_rad: object


class Verdict(NamedTuple):
    goal_index: object
    done: object
    reason: object


class Turn:
    arrived_m = None  # there is no place to go to

    def __init__(self, turns):
        self._turns_rad = 2 * np.pi * turns

    def place(self, world, floor, hull_radius_m, rng):
        start = np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        return Placement(start, np.zeros((1, 2)))

    def init(self, start, goals_m):
        return Turned(start[2], jnp.zeros(()))

    def step(self, state, truth):
        change = truth.pose[2] - state.yaw_rad
        turned = state.turned_rad + jnp.arctan2(jnp.sin(change), jnp.cos(change))
        passed, hit = jnp.abs(turned) >= self._turns_rad, truth.impulse_ns > HARD_IMPULSE_NS
        reason = jnp.where(hit, COLLISION, jnp.where(truth.inside, 0, OUT_OF_BOUNDS))
        done = passed | hit | ~truth.inside
        return Turned(truth.pose[2], turned), Verdict(passed.astype(jnp.int32), done, reason)

    def metrics(self, state):
        return {"turns": jnp.abs(state.turned_rad) / (2 * np.pi)}


def scenario(environment):
    return Turn(environment.get("TURNS", 1.0))
