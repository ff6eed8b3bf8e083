"""A scenario whose goals and whose array are as many as its map is large; it only ends by time."""
# ruff: noqa: ARG002 - the arguments are the contract's

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np

from specs.data.world import World
from tasks.simulate.application.contract import HostMap, Placement, Truth, Verdict


class Counted:
    arrived_m = None

    def place(self, world: World, floor: HostMap, hull_radius_m: float, rng: np.random.Generator) -> Placement:
        start = np.array([*rng.uniform(-0.4, 0.4, 2), rng.uniform(-3.0, 3.0)])
        return Placement(start, np.zeros((len(floor.clearance_m) // 64, 2)), (floor.clearance_m,), None)

    def init(self, start: jax.Array, goals_m: jax.Array, clearance_m: jax.Array) -> jax.Array:
        return jnp.array([goals_m.shape[0], *clearance_m.shape], jnp.float32)

    def step(self, state: jax.Array, truth: Truth) -> tuple[jax.Array, Verdict]:
        return state, Verdict(jnp.zeros((), jnp.int32), jnp.zeros((), bool), jnp.zeros((), jnp.int32))

    def metrics(self, state: jax.Array) -> dict[str, jax.Array]:
        return {"goals": state[0], "rows": state[1], "columns": state[2]}


def scenario(environment: Mapping[str, object]) -> Counted:
    return Counted()
