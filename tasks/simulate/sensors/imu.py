"""Inertial measurement unit and compass: turn rates, specific force and the earth's magnetic field, with their errors.

The unit reads the turn rates at a control step's end, and the mean specific force over the step, which is the
acceleration minus gravity, as springs and masses on a chip feel it.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from specs.data.episode import CONTROL_S
from tasks.simulate.application.contract import Body
from tasks.simulate.sensors.sensor import (
    Base,
    Drive,
    Fields,
    Memory,
    Scalar,
    Seed,
    Sensor,
    Situation,
    base_of,
    is_set,
    step_key,
    turned,
)

_WHITE, _WALK, _SCALE = 6, 7, 8
_IRON, _FIELD = 11, 12
_GRAVITY_M_S2 = 9.81
Vector = Float[Array, "3"]
Readings = Float[Array, "6"]


class Imu(NamedTuple):
    """An inertial measurement unit; fields as in ``ImuDeclaration``."""

    x_m: Scalar = 0.0
    y_m: Scalar = 0.0
    z_m: Scalar = 0.0
    yaw_rad: Scalar = 0.0
    gyro_sigma_rad_s: Scalar = 0.0
    gyro_walk_rad_s: Scalar = 0.0
    force_sigma_m_s2: Scalar = 0.0
    force_walk_m_s2: Scalar = 0.0
    scale_share: Scalar = 0.0
    rate_hz: float = 0.0
    latency_steps: int = 0


class ImuMemory(NamedTuple):
    """What an inertial measurement unit reads, turn rates first, and how far its zeros have walked."""

    readings: Readings
    walked: Readings


def true_readings(imu: Imu, before: Body, after: Body) -> Readings:
    """Returns what an inertial measurement unit without errors reads after a control step.

    The force is seen as the unit is turned in the middle of the step.

    Args:
        imu: How it is mounted.
        before: The robot at the step's beginning.
        after: At its end.
    """
    first, last = base_of(before), base_of(after)
    mount = jnp.stack([jnp.asarray(value, after.qpos.dtype) for value in (imu.x_m, imu.y_m, imu.z_m)])

    def speed(base: Base) -> Vector:
        return base.speed_m_s + turned(base.quaternion, jnp.cross(base.turn_rad_s, mount))

    up = jnp.zeros(3, after.qpos.dtype).at[2].set(_GRAVITY_M_S2)
    force = (speed(last) - speed(first)) / CONTROL_S + up
    # A quaternion and its opposite are the same turn.
    alike = jnp.where(jnp.sum(first.quaternion * last.quaternion) < 0.0, -1.0, 1.0)
    middle = first.quaternion + alike * last.quaternion
    middle = middle / jnp.sqrt(jnp.sum(middle**2))
    return jnp.concatenate([_mounted(imu, each) for each in (last.turn_rad_s, turned(middle, force, back=True))])


def _mounted(imu: Imu, vector: Vector) -> Vector:
    if not is_set(imu.yaw_rad):
        return vector
    cos, sin = jnp.cos(imu.yaw_rad), jnp.sin(imu.yaw_rad)
    return jnp.stack([cos * vector[0] + sin * vector[1], cos * vector[1] - sin * vector[0], vector[2]])


def _each(gyro: Scalar, force: Scalar) -> Readings:
    return jnp.repeat(jnp.stack([jnp.asarray(gyro, jnp.float32), jnp.asarray(force, jnp.float32)]), 3)


def noisy(imu: Imu, true: Readings, walked: Readings, seed: Seed, step: Array) -> ImuMemory:
    """Returns what a unit reads, and how far its zeros have walked then.

    Args:
        imu: How it errs.
        true: What it would read without errors.
        walked: How far its zeros had walked a control step before.
        seed: The episode's.
        step: Which control step; each has its own errors, but for the scale, which is the episode's.
    """

    def drawn(stream: int, at: Any) -> Readings:  # noqa: ANN401 - a number or an array
        return jax.random.normal(step_key(seed, stream, at), (6,), true.dtype)

    readings = true
    if is_set(imu.scale_share):
        readings = readings * (1.0 + imu.scale_share * drawn(_SCALE, jnp.int32(0)))
    if is_set(imu.gyro_walk_rad_s) or is_set(imu.force_walk_m_s2):
        walk = _each(imu.gyro_walk_rad_s, imu.force_walk_m_s2) * math.sqrt(CONTROL_S)
        walked = walked + walk * drawn(_WALK, step)
        readings = readings + walked
    if is_set(imu.gyro_sigma_rad_s) or is_set(imu.force_sigma_m_s2):
        readings = readings + _each(imu.gyro_sigma_rad_s, imu.force_sigma_m_s2) * drawn(_WHITE, step)
    return ImuMemory(readings, walked)


def _begin(_shared: Imu, own: Imu, start: Situation) -> Memory:
    still = start.body._replace(qvel=jnp.zeros_like(start.body.qvel))
    return noisy(own, true_readings(own, still, still), jnp.zeros(6), start.seed, start.step)


def _feel(_shared: Imu, own: Imu, memory: Memory, drive: Drive) -> Memory:
    after = drive.after
    true = true_readings(own, drive.before.body, after.body)
    return noisy(own, true, memory.walked, after.seed, after.step)


def _fields(readings: Readings) -> Fields:
    return {"turn_rad_s": readings[:3], "force_m_s2": readings[3:]}


def _observe(_shared: Imu, _own: Imu, memory: Memory, _situation: Situation) -> Fields:
    return _fields(memory.readings)


def _blank(_shared: Imu) -> Fields:
    return _fields(jnp.zeros(6))


IMU = Sensor(
    name="imu",
    kind=Imu,
    absent=None,
    blank=_blank,
    begin=_begin,
    feel=_feel,
    observe=_observe,
    limits=dict.fromkeys(("x_m", "y_m", "z_m", "yaw_rad"), (-1e4, 1e4)) | {"scale_share": (0.0, 1.0)},
    streams=(_WHITE, _WALK, _SCALE),
)


class Compass(NamedTuple):
    """A magnetometer; fields as in ``CompassDeclaration``."""

    north_rad: Scalar = math.pi / 2
    level_ut: Scalar = 20.0
    down_ut: Scalar = 45.0
    sigma_ut: Scalar = 0.0
    bias_ut: Scalar = 0.0
    rate_hz: float = 0.0
    latency_steps: int = 0


def _field(_shared: Compass, own: Compass, _memory: Memory, now: Situation) -> Fields:
    earth = (own.level_ut * jnp.cos(own.north_rad), own.level_ut * jnp.sin(own.north_rad), -own.down_ut)
    found = turned(
        base_of(now.body).quaternion, jnp.stack([jnp.asarray(each, jnp.float32) for each in earth]), back=True
    )
    for sigma, stream, at in ((own.bias_ut, _IRON, jnp.int32(0)), (own.sigma_ut, _FIELD, now.step)):
        if is_set(sigma):
            found = found + sigma * jax.random.normal(step_key(now.seed, stream, at), (3,), found.dtype)
    return {"field_ut": found}


COMPASS = Sensor(
    name="compass",
    kind=Compass,
    absent=None,
    blank=lambda _: {"field_ut": jnp.zeros(3)},
    observe=_field,
    limits=dict.fromkeys(("north_rad", "down_ut"), (-1e4, 1e4)),
    streams=(_IRON, _FIELD),
)
