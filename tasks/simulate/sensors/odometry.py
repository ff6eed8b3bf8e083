"""Wheel odometry: the pose that the robot believes to have, which drifts away from its true one."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from tasks.simulate.sensors.sensor import Drive, Fields, Memory, Scalar, Seed, Sensor, Situation, rotate, step_key

Pose = Float[Array, "3"]
_NOISE = 2
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


def _begin(shared: Odometry | None, _own: Odometry | None, start: Situation) -> Memory:
    return None if shared is None else start.body.qpos


def _feel(_shared: Odometry | None, own: Odometry | None, believed: Memory, drive: Drive) -> Memory:
    if own is None or believed is None:
        return None
    before, after = drive.before, drive.motion.body.qpos
    return believed_pose(believed, before.body.qpos, after, own, seed=before.seed, step=before.step)


def _observe(_shared: Odometry | None, _own: Odometry | None, believed: Memory, situation: Situation) -> Fields:
    """Returns where the robot believes to be, and how it moves as it sees itself; nothing where it knows."""
    if believed is None:
        return {}
    pose, velocity = situation.body.qpos, situation.body.qvel
    return {"pose": believed, "velocity": rotate(velocity, believed[2] - pose[2])}


def _blank(_shared: Odometry | None) -> Fields:
    return {}


ODOMETRY = Sensor(
    name="odometry",
    kind=Odometry,
    absent=None,
    blank=_blank,
    begin=_begin,
    feel=_feel,
    observe=_observe,
    limits={},
    streams=(_NOISE,),
)
