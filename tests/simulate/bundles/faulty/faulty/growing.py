"""A controller whose state grows at every step, which no compiled loop can hold."""
# ruff: noqa: ARG002 - the arguments are the contract's

from collections.abc import Mapping

import jax
import jax.numpy as jnp

from tasks.simulate.application.contract import FloorMap, Observation

from .pushing import Control, Pushing, Steps


class Growing(Pushing):
    def init(self, floor: FloorMap, goals_m: jax.Array) -> Steps:
        return jnp.zeros(1)

    def step(self, state: Steps, observation: Observation) -> tuple[Steps, Control]:
        return jnp.concatenate([state, state]), jnp.zeros(3)


def controller(environment: Mapping[str, object]) -> Growing:
    return Growing(0.0)
