"""A robot's pose and velocity in the plane from its coordinates, and back, for one robot or many.

The functions take NumPy or ``jax.numpy``, as the arrays are; coordinates are in the last axis.
"""

from types import ModuleType
from typing import Any

from tasks.simulate.application.robot_mjcf import Base

# Arrays of either library.
Arrays = Any
_PLACE = 3  # x, y and height come first in a free joint's coordinates, then its quaternion
_POSE = 7


def coordinates_at(base: Base, rest: Arrays, start: Arrays, numbers: ModuleType) -> Arrays:
    """Returns the coordinates of a robot at a start (x m, y m, yaw rad), as tall as it rests, turned about z.

    Args:
        base: How the robot stands in the world.
        rest: Its coordinates at rest.
        start: Where it shall stand.
        numbers: NumPy or ``jax.numpy``.
    """
    others = numbers.broadcast_to(rest, (*start.shape[:-1], rest.shape[-1]))
    if not base.free:
        return numbers.concatenate([start, others[..., 3:]], axis=-1)
    turned = _turned_about_z(start[..., 2], others[..., _PLACE:_POSE], numbers)
    return numbers.concatenate([start[..., :2], others[..., 2:3], turned, others[..., _POSE:]], axis=-1)


def pose_of(base: Base, qpos: Arrays, numbers: ModuleType) -> Arrays:
    """Returns (x m, y m, yaw rad); yaw from -pi to pi for a robot with a free joint, else counted on."""
    if not base.free:
        return qpos[..., :3]
    w, x, y, z = (qpos[..., _PLACE + k] for k in range(4))
    yaw = numbers.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return numbers.concatenate([qpos[..., :2], yaw[..., None]], axis=-1)


def velocity_of(base: Base, qpos: Arrays, qvel: Arrays, numbers: ModuleType) -> Arrays:
    """Returns (m/s, m/s, rad/s) along the world's axes.

    A free joint's turn rates are along the body's own axes (MuJoCo documentation, "Floating objects").

    Args:
        base: How the robot stands in the world.
        qpos: Its coordinates.
        qvel: Its speeds.
        numbers: NumPy or ``jax.numpy``.
    """
    if not base.free:
        return qvel[..., :3]
    w, x, y, z = (qpos[..., _PLACE + k] for k in range(4))
    upward = (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
    about_x, about_y, about_z = (share * qvel[..., _PLACE + k] for k, share in enumerate(upward))
    turn = about_x + about_y + about_z
    return numbers.concatenate([qvel[..., :2], turn[..., None]], axis=-1)


def _turned_about_z(yaw_rad: Arrays, quaternion: Arrays, numbers: ModuleType) -> Arrays:
    cos, sin = numbers.cos(yaw_rad / 2.0), numbers.sin(yaw_rad / 2.0)
    w, x, y, z = (quaternion[..., k] for k in range(4))
    return numbers.stack([cos * w - sin * z, cos * x - sin * y, cos * y + sin * x, cos * z + sin * w], axis=-1)
