"""Wheels that count: encoders, and the pose that the robot believes to have, which drifts away from its true one."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from tasks.simulate.sensors.sensor import (
    Drive,
    Fields,
    Memory,
    Scalar,
    Seed,
    Sensor,
    Situation,
    is_set,
    rotate,
    step_key,
)

Pose = Float[Array, "3"]
_NOISE = 2
_SLIP, _SCALE = 13, 14
# A way shorter than this is none: nothing is divided by 0.
_REST_M = 1e-9


class Odometry(NamedTuple):
    """Wheel odometry.

    Errors are added up step by step, so their standard deviations grow with the square root of the way.

    Attributes:
        sigma_m_per_m: Of the way driven, after a metre.
        sigma_rad_per_m: Of the heading, after a metre.
        sigma_rad_per_rad: Of the heading, after turning by a radian.
    """

    sigma_m_per_m: Scalar = 0.0
    sigma_rad_per_m: Scalar = 0.0
    sigma_rad_per_rad: Scalar = 0.0


def believed_pose(
    believed: Pose, before: Pose, after: Pose, odometry: Odometry, *, seed: Seed, step: Int[Array, ""]
) -> Pose:
    """Returns the pose that a robot believes to have after a control step.

    Args:
        believed: What it believed before the step.
        before: Its true pose then.
        after: Its true pose now.
        odometry: How it errs.
        seed: The episode's.
        step: Which control step; each has its own errors.
    """
    way, turn_rad = after[:2] - before[:2], after[2] - before[2]
    way_m = jnp.sqrt(jnp.sum(way**2))
    draws = jax.random.normal(step_key(seed, _NOISE, step), (2,), believed.dtype)
    longer_m = odometry.sigma_m_per_m * jnp.sqrt(way_m) * draws[0]
    yaw_variance = odometry.sigma_rad_per_m**2 * way_m + odometry.sigma_rad_per_rad**2 * jnp.abs(turn_rad)
    counted = way * (1.0 + longer_m / jnp.maximum(way_m, _REST_M))
    lead_rad = believed[2] - before[2]
    cos, sin = jnp.cos(lead_rad), jnp.sin(lead_rad)
    x, y = cos * counted[0] - sin * counted[1], sin * counted[0] + cos * counted[1]
    yaw_rad = turn_rad + jnp.sqrt(yaw_variance) * draws[1]
    return believed + jnp.stack([x, y, yaw_rad])


def _begin(_shared: Odometry, _own: Odometry, start: Situation) -> Memory:
    return start.body.qpos


def _feel(_shared: Odometry, own: Odometry, believed: Memory, drive: Drive) -> Memory:
    before, after = drive.before, drive.motion.body.qpos
    return believed_pose(believed, before.body.qpos, after, own, seed=before.seed, step=before.step)


def _observe(_shared: Odometry, _own: Odometry, believed: Memory, situation: Situation) -> Fields:
    """Returns where the robot believes to be, and how it moves as it sees itself."""
    pose, velocity = situation.body.qpos, situation.body.qvel
    return {"pose": believed, "velocity": rotate(velocity, believed[2] - pose[2])}


ODOMETRY = Sensor(
    name="odometry",
    kind=Odometry,
    absent=None,
    blank=lambda _: {},
    begin=_begin,
    feel=_feel,
    observe=_observe,
    limits={},
    streams=(_NOISE,),
)


class WheelEncoders(NamedTuple):
    """Counters of a left and a right wheel; fields as in ``WheelEncodersDeclaration``."""

    track_m: Scalar = 0.3
    tick_m: Scalar = 0.001
    sigma_m_per_m: Scalar = 0.0
    scale_share: Scalar = 0.0
    rate_hz: float = 0.0
    latency_steps: int = 0


def _roll(_shared: WheelEncoders, own: WheelEncoders, rolled_m: Memory, drive: Drive) -> Memory:
    before, way = drive.before, drive.motion.body.qpos - drive.before.body.qpos
    # In a curve it goes ahead as it faces in the middle of the step.
    ahead_m = rotate(way[:2], -(before.body.qpos[2] + way[2] / 2))[0]
    each_m = ahead_m + way[2] * own.track_m * jnp.array([-0.5, 0.5])
    if is_set(own.scale_share):
        drawn = jax.random.normal(step_key(before.seed, _SCALE, jnp.int32(0)), (2,), each_m.dtype)
        each_m = each_m * (1.0 + own.scale_share * drawn)
    if is_set(own.sigma_m_per_m):
        drawn = jax.random.normal(step_key(before.seed, _SLIP, before.step), (2,), each_m.dtype)
        each_m = each_m + own.sigma_m_per_m * jnp.sqrt(jnp.abs(each_m)) * drawn
    return rolled_m + each_m


def _count(_shared: WheelEncoders, own: WheelEncoders, rolled_m: Memory, _situation: Situation) -> Fields:
    return {"ticks": jnp.floor(rolled_m / own.tick_m).astype(jnp.int32)}


WHEEL_ENCODERS = Sensor(
    name="wheel_encoders",
    kind=WheelEncoders,
    absent=None,
    blank=lambda _: {"ticks": jnp.zeros(2, jnp.int32)},
    begin=lambda _shared, _own, _start: jnp.zeros(2),
    feel=_roll,
    observe=_count,
    limits={"tick_m": (1e-6, 1e4)},
    streams=(_SLIP, _SCALE),
)
