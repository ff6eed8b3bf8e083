"""Planar bases and obstacles for the planar engine's tests, and C MuJoCo beside them."""

import functools
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from specs.data.episode import CONTROL_S
from specs.data.world import MOST_CORNERS
from tasks.simulate.application.contract import Body, Motion
from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import add_obstacle, add_prism_mesh, collision_bits
from tasks.simulate.engines.planar.planar_engine import drive_among, first_body
from tasks.simulate.engines.planar.planar_robot import PlanarRobot, planar_robot
from tasks.simulate.geometry.hull_distance import LaneObstacles

WHEELS = """
    <velocity name="forward" site="drive" gear="1 0 0 0 0 0" kv="40" ctrlrange="-1 1" forcerange="-15 15"/>
    <velocity name="turn" joint="yaw" kv="1" ctrlrange="-3 3" forcerange="-3 3"/>
    <velocity name="hold" site="drive" gear="0 1 0 0 0 0" kv="100" forcerange="-15 15"/>"""
MOTORS = '<motor joint="x"/><motor joint="y"/><motor joint="yaw"/>'
# A robot as element/attribute: value; motors and further parts of its body as they are in a file.
Parts = Mapping[str, str]
COURIER: Parts = {
    "option/timestep": "0.005",
    "hull/type": "sphere",
    "hull/size": "0.18",
    "hull/mass": "2",
    "hull/condim": "1",
    "motors": WHEELS,
    "more": "",
}
ROUGH: Parts = {"hull/condim": "3", "hull/friction": "0.5"}
DRUM: Parts = {"hull/type": "cylinder", "hull/size": "0.18 0.1"}
CAPSULE: Parts = {"hull/type": "capsule", "hull/size": "0.18 0.1"}
# A weight off the axis, so that the mass matrix turns with the base.
LOAD = '<geom type="box" size=".02 .02 .02" pos="0.12 0.05 0" mass="3" contype="0" conaffinity="0"/>'
NO_BOXES, NO_CYLINDERS, NO_PRISMS = np.zeros((0, 8)), np.zeros((0, 5)), np.zeros((0, 20))
_LEAST_BOXES, _LEAST_CYLINDERS = 2, 1
_READ: dict[str, PlanarRobot] = {}


class Obstacles(NamedTuple):
    """Boxes (n, 8), cylinders (n, 5) and prisms (n, 20) as the engine has them."""

    boxes: np.ndarray
    cylinders: np.ndarray
    prisms: np.ndarray = NO_PRISMS


class Path3(NamedTuple):
    """Poses and velocities, (steps, lanes, 3)."""

    pose: np.ndarray
    velocity: np.ndarray


def write_robot(folder: Path, parts: Parts) -> Path:
    """Returns the ``robot.xml`` of a base that is the courier but for what is given."""
    robot = {**COURIER, **parts}

    def attributes(element: str) -> str:
        of_it = {
            key.removeprefix(f"{element}/"): value for key, value in robot.items() if key.startswith(f"{element}/")
        }
        return " ".join(f'{name}="{value}"' for name, value in of_it.items())

    path = folder / "robot.xml"
    path.write_text(
        f"""<mujoco><compiler autolimits="true"/>
        <option {attributes("option")}><flag {attributes("flag")}/></option>
        <worldbody><body name="base" pos="0 0 0.2">
          <joint name="x" type="slide" axis="1 0 0" {attributes("x")}/>
          <joint name="y" type="slide" axis="0 1 0" {attributes("y")}/>
          <joint name="yaw" type="hinge" axis="0 0 1" {attributes("yaw")}/>
          <geom name="hull" {attributes("hull")}/>{robot["more"]}<site name="drive" size="0.01"/>
        </body></worldbody><actuator>{robot["motors"]}</actuator></mujoco>"""
    )
    return path


def box(
    x: float, y: float, half_x: float, half_y: float, *, yaw: float = 0.0, z: float = 0.5, half_z: float = 0.5
) -> list[float]:
    """Returns a box as the engine has it."""
    return [x, y, z, half_x, half_y, half_z, np.cos(yaw), np.sin(yaw)]


def prism(x: float, y: float, corners: np.ndarray, *, z: float = 0.5, half_z: float = 0.5) -> list[float]:
    """Returns a prism as the engine has it."""
    filled = np.concatenate([corners, np.repeat(corners[-1:], MOST_CORNERS - len(corners), axis=0)])
    return [x, y, z, half_z, *filled.ravel().tolist()]


def among(path: Path, obstacles: Obstacles) -> mujoco.MjModel:
    """Returns a robot for C MuJoCo among obstacles."""
    spec = read_robot_mjcf(path)
    bits = collision_bits(spec)
    for number, (x, y, z, half_x, half_y, half_z, cos, sin) in enumerate(obstacles.boxes):
        geom = add_obstacle(spec, f"box-{number}", mujoco.mjtGeom.mjGEOM_BOX, bits)
        geom.pos, geom.size = [x, y, z], [half_x, half_y, half_z]
        half_yaw = np.arctan2(sin, cos) / 2
        geom.quat = [np.cos(half_yaw), 0.0, 0.0, np.sin(half_yaw)]
    for number, (x, y, z, radius, half_z) in enumerate(obstacles.cylinders):
        geom = add_obstacle(spec, f"cylinder-{number}", mujoco.mjtGeom.mjGEOM_CYLINDER, bits)
        geom.pos, geom.size = [x, y, z], [radius, half_z, 0.0]
    for number, prism in enumerate(obstacles.prisms):
        (x, y, z, half_z), corners = prism[:4], prism[4:].reshape(-1, 2)
        add_prism_mesh(spec, f"prism-{number}", corners, half_z)
        geom = add_obstacle(spec, f"prism-{number}", mujoco.mjtGeom.mjGEOM_MESH, bits)
        geom.meshname, geom.pos = f"prism-{number}", [x, y, z]
    return spec.compile()


def drive_c(model: mujoco.MjModel, start: np.ndarray, controls: np.ndarray) -> Path3:
    """Returns where C MuJoCo drives one robot, (steps, 3)."""
    data = mujoco.MjData(model)
    data.qpos[:3] = start
    states: list[np.ndarray] = []
    for control in controls:
        data.ctrl[:] = control
        mujoco.mj_step(model, data, nstep=round(CONTROL_S / model.opt.timestep))
        states.append(np.concatenate([data.qpos[:3], data.qvel[:3]]))
    return Path3(np.array(states)[:, :3], np.array(states)[:, 3:])


def drive_planar(
    robot: PlanarRobot,
    obstacles: Obstacles,
    starts: np.ndarray,
    controls: np.ndarray,
    states: np.ndarray | None = None,
) -> Motion:
    """Returns what the engine makes of each control step, (steps, lanes, ...).

    Args:
        robot: As the engine reads it.
        obstacles: Of each lane, (lanes, n, ...).
        starts: (lanes, 3).
        controls: (steps, lanes, actuators).
        states: Poses and velocities that the control steps begin in, (steps, lanes, 6); where the one before ended
            if there are none.
    """
    around = on_device(obstacles)
    begin = jax.vmap(functools.partial(first_body, robot))(jnp.asarray(starts, jnp.float32))
    afresh = jnp.asarray(states is not None)
    given = np.zeros((*controls.shape[:2], 6)) if states is None else states
    told = (jnp.asarray(controls, jnp.float32), jnp.asarray(given, jnp.float32))
    return jax.device_get(_drive(robot, around, begin, told, afresh))


@functools.partial(jax.jit, static_argnums=0)
def _drive(
    robot: PlanarRobot,
    around: LaneObstacles,
    begin: Body,
    told: tuple[jax.Array, jax.Array],
    afresh: jax.Array,
) -> Motion:
    step = jax.vmap(functools.partial(drive_among, robot))

    def advance(body: Body, now: tuple[jax.Array, jax.Array]) -> tuple[Body, Motion]:
        control, state = now
        pose, velocity = jnp.where(afresh, state[:, :3], body.qpos), jnp.where(afresh, state[:, 3:], body.qvel)
        motion = step(around, body._replace(qpos=pose, qvel=velocity), control)
        return motion.body, motion

    return jax.lax.scan(advance, begin, told)[1]


def padded(obstacles: Obstacles) -> Obstacles:
    """Returns one robot's obstacles with some far away, so that all tests of a robot share a compilation."""
    boxes = [box(900.0 + number, 900.0, 0.1, 0.1) for number in range(_LEAST_BOXES)]
    cylinders = [[-900.0 - number, -900.0, 0.5, 0.1, 0.5] for number in range(_LEAST_CYLINDERS)]
    return Obstacles(
        np.concatenate([obstacles.boxes, np.array(boxes)[len(obstacles.boxes) :]]),
        np.concatenate([obstacles.cylinders, np.array(cylinders)[len(obstacles.cylinders) :]]),
        obstacles.prisms,
    )


def on_device(obstacles: Iterable[np.ndarray]) -> LaneObstacles:
    """Returns obstacles as the engine is given them."""
    return LaneObstacles(*(jnp.asarray(kind, jnp.float32) for kind in obstacles))


def both(path: Path, obstacles: Obstacles, start: list[float], controls: np.ndarray) -> tuple[Motion, Path3]:
    """Returns what the engine and C MuJoCo make of one robot's controls, (steps, ...)."""
    alone = Obstacles(*(each[None] for each in padded(obstacles)))
    motion = drive_planar(read(path), alone, np.array([start]), controls[:, None])
    return jax.tree.map(lambda array: array[:, 0], motion), drive_c(among(path, obstacles), np.array(start), controls)


def read(path: Path) -> PlanarRobot:
    """Returns the robot of a file; the same object for the same text, so that it is compiled once."""
    text = path.read_text()
    if text not in _READ:
        _READ[text] = planar_robot(path)
    return _READ[text]
