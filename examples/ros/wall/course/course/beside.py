"""A course: the robot drives METRES with something within NEAR_M of its hull, and runs into nothing."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

COLLISION, OUT_OF_BOUNDS, HARD_IMPULSE_NS = 1, 4, 0.1


class Placement(NamedTuple):
    start: np.ndarray
    goals_m: np.ndarray


class Driven(NamedTuple):
    place_m: object
    way_m: object


class Verdict(NamedTuple):
    goal_index: object
    done: object
    reason: object


class Beside:
    arrived_m = None  # there is no place to go to

    def __init__(self, metres, near_m):
        self._metres, self._near_m = metres, near_m

    def place(self, world, floor, hull_radius_m, rng):
        start = np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        return Placement(start, np.zeros((1, 2)))

    def init(self, start, goals_m):
        return Driven(start[:2], jnp.zeros(()))

    def step(self, state, truth):
        here = truth.pose[:2]
        step_m = jnp.sqrt(jnp.sum((here - state.place_m) ** 2))
        way_m = state.way_m + jnp.where(truth.clearance_m < self._near_m, step_m, 0.0)
        passed, hit = way_m >= self._metres, truth.impulse_ns > HARD_IMPULSE_NS
        reason = jnp.where(hit, COLLISION, jnp.where(truth.inside, 0, OUT_OF_BOUNDS))
        return Driven(here, way_m), Verdict(passed.astype(jnp.int32), passed | hit | ~truth.inside, reason)

    def metrics(self, state):
        return {"metres_beside": state.way_m}


def scenario(environment):
    return Beside(environment.get("METRES", 5.0), environment.get("NEAR_M", 0.6))
