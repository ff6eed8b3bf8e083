"""The same episode on C MuJoCo with every solid of the world: what the fast path is measured against."""

from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float64

from specs.data.episode import CONTROL_S
from specs.data.world import World
from tasks.simulate.engines.mujoco.world_stepper import host_robot, world_model
from tasks.simulate.geometry.depth_picture import View, rays_of
from tasks.simulate.sensors.lidar import Lidar, ray_angles


def reference_model(robot: Path, world: World) -> mujoco.MjModel:
    """Returns a robot among all solids of a world, with the solver that its ``robot.xml`` asks for.

    Raises:
        RobotRefused: No engine could drive the robot.
    """
    return world_model(host_robot(robot), world)


def visible_model(robot: Path, world: World) -> mujoco.MjModel:
    """Returns the same with a floor and a ceiling, which no planar base touches."""
    stage = host_robot(robot)
    stage.spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50.0, 50.0, 0.1])
    above = [0.0, 0.0, world.ceiling_height_m + 0.5]
    stage.spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[50.0, 50.0, 0.5], pos=above)
    return world_model(stage, world)


def replay(
    model: mujoco.MjModel, start: Float64[np.ndarray, "3"], controls: Float64[np.ndarray, "steps actuators"]
) -> Float64[np.ndarray, "steps 3"]:
    """Returns the poses at the ends of control steps when a robot gets these controls from that pose."""
    data = mujoco.MjData(model)
    data.qpos[:3] = start
    poses = np.empty((len(controls), 3))
    for step, control in enumerate(controls):
        data.ctrl[:] = control
        mujoco.mj_step(model, data, nstep=round(CONTROL_S / model.opt.timestep))
        poses[step] = data.qpos[:3]
    return poses


def reference_ranges(
    model: mujoco.MjModel, lidar: Lidar, pose: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "rays"]:
    """Returns the distances that MuJoCo's own rays measure from a pose, the robot itself left out."""
    data = mujoco.MjData(model)
    data.qpos[:3] = pose
    mujoco.mj_forward(model, data)
    angles = pose[2] + ray_angles(lidar).astype(np.float64)
    directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(lidar.rays)], axis=1)
    geoms, ranges = np.empty(lidar.rays, np.int32), np.empty(lidar.rays)
    eye = np.array([pose[0], pose[1], lidar.height_m])
    base = int(model.jnt_bodyid[0])
    mujoco.mj_multiRay(
        model, data, eye, directions.ravel(), None, 1, base, geoms, ranges, None, lidar.rays, lidar.range_m
    )
    return np.where(ranges < 0.0, lidar.range_m, np.minimum(ranges, lidar.range_m))


def reference_depths(
    model: mujoco.MjModel, view: View, eye: Float64[np.ndarray, "4"]
) -> Float64[np.ndarray, "rows columns"]:
    """Returns the depths that MuJoCo's own rays measure from (x m, y m, z m, yaw rad), the robot itself left out."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    parts = (each.astype(np.float64) for each in np.broadcast_arrays(*rays_of(view)))
    ahead, left, up = (each.ravel() for each in parts)
    cos, sin = np.cos(eye[3]), np.sin(eye[3])
    rays = np.stack([cos * ahead - sin * left, sin * ahead + cos * left, up], axis=1)
    lengths, count = np.linalg.norm(rays, axis=1), len(rays)
    geoms, found = np.empty(count, np.int32), np.empty(count)
    base = int(model.jnt_bodyid[0])
    directions = (rays / lengths[:, None]).ravel()
    mujoco.mj_multiRay(model, data, eye[:3], directions, None, 1, base, geoms, found, None, count, 1e3)
    depths = np.where(found < 0.0, view.range_m, np.minimum(found / lengths, view.range_m))
    return depths.reshape(view.rows, view.columns)
