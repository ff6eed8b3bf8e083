"""A drill: the robot drives METRES about a flat, and runs into nothing."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .turn import COLLISION, HARD_IMPULSE_NS, OUT_OF_BOUNDS, Placement, Verdict


class Driven(NamedTuple):
    place_m: object
    way_m: object


class Roam:
    arrived_m = None  # there is no place to go to

    def __init__(self, metres):
        self._metres = metres

    def place(self, world, floor, hull_radius_m, rng):
        start = np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        return Placement(start, np.zeros((1, 2)))

    def init(self, start, goals_m):
        return Driven(start[:2], jnp.zeros(()))

    def step(self, state, truth):
        here = truth.pose[:2]
        way = state.way_m + jnp.sqrt(jnp.sum((here - state.place_m) ** 2))
        passed, hit = way >= self._metres, truth.impulse_ns > HARD_IMPULSE_NS
        reason = jnp.where(hit, COLLISION, jnp.where(truth.inside, 0, OUT_OF_BOUNDS))
        done = passed | hit | ~truth.inside
        return Driven(here, way), Verdict(passed.astype(jnp.int32), done, reason)

    def metrics(self, state):
        return {"metres": state.way_m}


def scenario(environment):
    return Roam(environment.get("METRES", 4.0))
