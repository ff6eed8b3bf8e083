"""What a camera sees of its own robot: one picture wherever that drives, since both stand on the same base.

MuJoCo's rays measure it, once a camera, so that every shape is as exact as MuJoCo has it.
"""

import functools
from pathlib import Path
from typing import NamedTuple, get_args

import mujoco
import numpy as np
from jaxtyping import Float32, Float64

from specs.data.robot_shape import PartKind
from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import base_of, compile_robot, resting
from tasks.simulate.geometry.depth_picture import View, rays_of

_PICTURES_KEPT, _ROBOTS_KEPT = 64, 8
_SIX_SIDES = np.concatenate([np.eye(3), -np.eye(3)])
_KINDS = [getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}").value for kind in get_args(PartKind)]


class Mount(NamedTuple):
    """Where a camera is on its robot: ahead, to the left, above the floor, and turned counter-clockwise."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float


@functools.lru_cache(maxsize=_PICTURES_KEPT)
def hull_picture(robot: Path, view: View, mount: Mount) -> Float32[np.ndarray, "rows columns"]:
    """Returns the depth of the robot in each pixel, the view's range where it is not seen.

    It is what ``robot_shape`` has: what is seen of it, as it stands at the start. What a camera is inside of it does
    not see.

    Args:
        robot: The ``robot.xml``.
        view: The camera's picture.
        mount: Where the camera is.

    Raises:
        RobotRefused: No engine takes the robot.
    """
    model, data = _seen(robot)
    x, y = data.xpos[base_of(model).body][:2] + mount[:2]
    eye = np.array([x, y, mount.z_m])
    alphas = model.geom_rgba[:, 3].copy()
    for geom in np.flatnonzero(alphas).tolist():
        model.geom_rgba[:, 3] = 0.0
        model.geom_rgba[geom, 3] = 1.0
        alphas[geom] = (_distances_m(model, data, eye, _SIX_SIDES) < 0.0).any()
    model.geom_rgba[:, 3] = alphas
    ahead, left, up = (each.astype(np.float64).ravel() for each in np.broadcast_arrays(*rays_of(view)))
    cos, sin = np.cos(mount.yaw_rad), np.sin(mount.yaw_rad)
    rays = np.stack([cos * ahead - sin * left, sin * ahead + cos * left, up], axis=1)
    lengths = np.linalg.norm(rays, axis=1)
    found_m = _distances_m(model, data, eye, rays / lengths[:, None])
    depth_m = np.where(found_m < 0.0, view.range_m, np.minimum(found_m / lengths, view.range_m))
    picture = depth_m.astype(np.float32).reshape(view.rows, view.columns)
    picture.setflags(write=False)
    return picture


def _seen(robot: Path) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Returns a robot of which rays meet what is seen, at rest; its own copy, since who looks hides parts."""
    model = _compiled(robot).__copy__()
    data = resting(model)
    of_robot = model.body_weldid[model.geom_bodyid] != 0
    seen = of_robot & (model.geom_rgba[:, 3] > 0.0) & np.isin(model.geom_type, _KINDS)
    model.geom_matid[:], model.geom_rgba[:, 3] = -1, seen  # rays pass by what is wholly transparent
    return model, data


@functools.lru_cache(maxsize=_ROBOTS_KEPT)
def _compiled(robot: Path) -> mujoco.MjModel:
    return compile_robot(read_robot_mjcf(robot))


def _distances_m(
    model: mujoco.MjModel, data: mujoco.MjData, eye: Float64[np.ndarray, "3"], rays: Float64[np.ndarray, "rays 3"]
) -> Float64[np.ndarray, "rays"]:
    """Returns how far along rays of a metre the first geom is met; -1 where none is."""
    geoms, found_m = np.empty(len(rays), np.int32), np.empty(len(rays))
    far_m = mujoco.mjMAXVAL
    mujoco.mj_multiRay(model, data, eye, rays.ravel(), None, 1, -1, geoms, found_m, None, len(rays), far_m)
    return found_m
