"""Swings all actuators of a robot that it knows nothing of but how many there are: ACTUATORS, as ``x8``."""
# ruff: noqa: ARG002 - the arguments are the contract's

from collections.abc import Mapping

import jax
import jax.numpy as jnp

from tasks.simulate.application.contract import FloorMap, Observation


class Imu:
    """As a robot has it that declares no errors: a unit on the base's own origin."""


class CliffSensors:
    sensors = 2


class Swinging:
    imu = wheel_encoders = compass = gps = Imu()
    cliff_sensors = CliffSensors()

    def __init__(self, actuators: int) -> None:
        self._actuators = actuators

    def init(self, floor: FloorMap, goals_m: jax.Array) -> tuple[()]:
        return ()

    def step(self, state: tuple[()], observation: Observation) -> tuple[tuple[()], jax.Array]:
        assert observation.joints is not None  # what swings has joints
        assert observation.turn_rad_s is not None
        assert observation.ticks is not None
        assert observation.field_ut is not None
        assert observation.cliff_m is not None
        assert observation.gps_m is not None
        felt = observation.ticks[0] + observation.field_ut[0] + observation.cliff_m[0] + observation.gps_m[2]
        turn = 0.001 * felt + observation.joints.qpos[-1] + observation.joints.qvel[-1] + observation.turn_rad_s[0]
        phase = 6.0 * observation.time_s + jnp.arange(self._actuators) + 0.01 * turn
        return state, 0.3 * jnp.sin(phase)


def controller(environment: Mapping[str, str]) -> Swinging:
    return Swinging(int(environment["ACTUATORS"].removeprefix("x")))
