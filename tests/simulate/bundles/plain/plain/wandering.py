"""A controller in JAX with every sensor, all of them noisy, that wanders, and goes wrong in the way that FAULT says."""
# ruff: noqa: ARG002 - the arguments are the contract's

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp

from tasks.simulate.application.contract import FloorMap, Observation

NOT_FINITE, EXPLODING = 1.0, 2.0
_LATE_S = 1.0


class Lidar(NamedTuple):
    rays: int = 16
    range_m: float = 6.0
    height_m: float = 0.25
    sigma_m: float = 0.02
    dropout: float = 0.1


class Odometry(NamedTuple):
    sigma_m_per_m: float = 0.05
    sigma_rad_per_m: float = 0.05
    sigma_rad_per_rad: float = 0.05


class Bumper(NamedTuple):
    sectors: int = 4


class Wandering:
    lidar, odometry, bumper = Lidar(), Odometry(), Bumper()

    def __init__(self, fault: jax.Array | float) -> None:
        self._fault = fault

    def init(self, floor: FloorMap, goals_m: jax.Array) -> jax.Array:
        return jnp.zeros(())

    def step(self, state: jax.Array, observation: Observation) -> tuple[jax.Array, jax.Array]:
        turn = 0.9 * state + jnp.tanh(observation.ranges_m[2] - observation.ranges_m[-2]) - observation.pose[2] / 9
        push = jnp.where(observation.bumper.any(), -0.3, 0.5)
        late = observation.time_s > _LATE_S
        control = jnp.stack([push, 0.1 * observation.goal_robot_m[1], turn])
        control = jnp.where(late & (self._fault == NOT_FINITE), jnp.nan, control)
        return turn, jnp.where(late & (self._fault == EXPLODING), 4e10, control)


def controller(environment: Mapping[str, jax.Array | float]) -> Wandering:
    return Wandering(environment["FAULT"])
