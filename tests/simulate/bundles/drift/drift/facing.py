"""A scenario that puts all robots of a world in a row, and ends at a hard push; APART is how far they are apart."""
# ruff: noqa: ARG002 - the arguments are the contract's

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np

from specs.data.world import World
from tasks.simulate.application.contract import COLLISION, HostMap, Placement, Truth, Verdict


class Facing:
    def __init__(self, apart_m: float) -> None:
        self._apart_m = apart_m

    def place(self, world: World, floor: HostMap, hull_radius_m: float, rng: np.random.Generator) -> Placement:
        raise ValueError("nobody is alone here")

    def place_robots(
        self, world: World, floor: HostMap, hull_radius_m: float, rng: np.random.Generator, robots: int
    ) -> list[Placement]:
        starts = [np.array([self._apart_m * number, 0.0, np.pi * (number % 2)]) for number in range(robots)]
        return [Placement(start, np.array([[0.0, 0.0]])) for start in starts]

    def init(self, start: jax.Array, goals_m: jax.Array) -> jax.Array:
        return jnp.zeros(())

    def step(self, state: jax.Array, truth: Truth) -> tuple[jax.Array, Verdict]:
        hit = truth.impulse_ns > 0.01
        return state, Verdict(jnp.zeros((), jnp.int32), hit, jnp.where(hit, COLLISION, 0))


def scenario(environment: Mapping[str, float]) -> Facing:
    return Facing(environment["APART"])
