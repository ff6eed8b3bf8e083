"""Drives gymnasium's point, which is pushed along x alone and weighs 60 kg for 1 N, to the goal's x and stops there."""
# ruff: noqa: ARG002 - the arguments are the contract's

from collections.abc import Mapping

import jax
import jax.numpy as jnp

from tasks.simulate.application.contract import FloorMap, Observation

_BRAKES_M_S2 = 0.012


class ToAndFro:
    def init(self, floor: FloorMap, goals_m: jax.Array) -> tuple[()]:
        return ()

    def step(self, state: tuple[()], observation: Observation) -> tuple[tuple[()], jax.Array]:
        speed = observation.velocity[0]
        stop_m = observation.pose[0] + speed * jnp.abs(speed) / (2.0 * _BRAKES_M_S2)
        push = jnp.clip(20.0 * (observation.goal_m[0] - stop_m), -1.0, 1.0)
        return state, jnp.stack([push, jnp.zeros_like(push)])


def controller(environment: Mapping[str, object]) -> ToAndFro:
    return ToAndFro()
