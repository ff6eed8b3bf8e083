"""A controller that drives blindly in curves, and goes wrong in the way that FAULT says."""
# ruff: noqa: ARG002 - the arguments are the contract's

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp

from tasks.simulate.application.contract import FloorMap, Observation

SOUND, NOT_FINITE, TOO_STRONG, EXPLODING = 0.0, 1.0, 2.0, 3.0
Steps = jax.Array
Control = jax.Array


class Lidar(NamedTuple):
    rays: int = 8
    range_m: float = 6.0
    height_m: float = 0.25


class Pushing:
    lidar = Lidar()

    def __init__(self, fault: jax.Array | float) -> None:
        self._fault = fault

    def init(self, floor: FloorMap, goals_m: jax.Array) -> Steps:
        return jnp.zeros(())

    def step(self, state: Steps, observation: Observation) -> tuple[Steps, Control]:
        control = jnp.stack([jnp.float32(0.4), jnp.float32(0.0), 1.2 * jnp.sin(0.9 * observation.time_s)])
        late = observation.time_s > 1.0
        control = jnp.where(late & (self._fault == NOT_FINITE), jnp.nan, control)
        control = jnp.where(late & (self._fault == EXPLODING), 4e10, control)
        return state + 1.0, jnp.where(late & (self._fault == TOO_STRONG), 3e38, control)


def controller(environment: Mapping[str, jax.Array | float]) -> Pushing:
    return Pushing(environment["FAULT"])
