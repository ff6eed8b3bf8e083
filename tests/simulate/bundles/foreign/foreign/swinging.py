"""Swings all actuators of a robot that it knows nothing of but how many there are: ACTUATORS, as ``x8``."""
# ruff: noqa: ARG002 - the arguments are the contract's

from collections.abc import Mapping

import jax
import jax.numpy as jnp

from tasks.simulate.application.contract import FloorMap, Observation


class Imu:
    """As a robot has it that declares no errors: a unit on the base's own origin."""


class Swinging:
    imu = Imu()

    def __init__(self, actuators: int) -> None:
        self._actuators = actuators

    def init(self, floor: FloorMap, goals_m: jax.Array) -> tuple[()]:
        return ()

    def step(self, state: tuple[()], observation: Observation) -> tuple[tuple[()], jax.Array]:
        assert observation.joints is not None  # what swings has joints
        assert observation.turn_rad_s is not None
        turn = observation.joints.qpos[-1] + observation.joints.qvel[-1] + observation.turn_rad_s[0]
        phase = 6.0 * observation.time_s + jnp.arange(self._actuators) + 0.01 * turn
        return state, 0.3 * jnp.sin(phase)


def controller(environment: Mapping[str, str]) -> Swinging:
    return Swinging(int(environment["ACTUATORS"].removeprefix("x")))
