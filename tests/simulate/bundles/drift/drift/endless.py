"""A scenario that only ends by time, and that raises in a world named ``cursed``."""
# ruff: noqa: ARG002 - the arguments are the contract's

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np

from specs.data.world import World
from tasks.simulate.application.contract import HostMap, Placement, Truth, Verdict


class Endless:
    def place(self, world: World, floor: HostMap, hull_radius_m: float, rng: np.random.Generator) -> Placement:
        if world.name == "cursed":
            raise ValueError("nobody starts here")
        start = np.array([*rng.uniform(-0.4, 0.4, 2), rng.uniform(-3.0, 3.0)])
        return Placement(start, np.array([[0.0, 0.0]]))

    def init(self, start: jax.Array, goals_m: jax.Array) -> jax.Array:
        return jnp.zeros(())

    def step(self, state: jax.Array, truth: Truth) -> tuple[jax.Array, Verdict]:
        return state, Verdict(jnp.zeros((), jnp.int32), jnp.zeros((), bool), jnp.zeros((), jnp.int32))


def scenario(environment: Mapping[str, object]) -> Endless:
    return Endless()
