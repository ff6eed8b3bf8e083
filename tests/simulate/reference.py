"""The same episode on C MuJoCo with every solid of the world: what the fast path is measured against."""

from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float64

from specs.data.episode import CONTROL_S
from specs.data.world import World
from tasks.simulate.engines.mujoco.world_stepper import host_robot, world_model
from tasks.simulate.sensors.lidar import Lidar, ray_angles


def reference_model(robot: Path, world: World) -> mujoco.MjModel:
    """Returns a robot among all solids of a world, with the solver that its ``robot.xml`` asks for.

    Raises:
        RobotRefused: No engine could drive the robot.
    """
    return world_model(host_robot(robot), world)


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
