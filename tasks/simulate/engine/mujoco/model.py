"""A robot among all solids of a world, for C MuJoCo: all geoms as they are, and the solver of its ``robot.xml``."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float64

from specs.data.episode import CONTROL_S
from specs.data.world import Solid, World, solids
from tasks.simulate.application.robot_mjcf import (
    Base,
    Hull,
    add_obstacle,
    base_of,
    collision_bits,
    compile_robot,
    hull_of,
    read_robot_mjcf,
    rest_position,
)
from tasks.simulate.surroundings.hull_outline import HullPart, hull_parts
from tasks.simulate.surroundings.obstacles import PARKING_M

_SOLIDS = "simyard/solids"
_PUSH = "simyard/push"
_FORCE = "simyard/force/"
_SPEED = "simyard/speed/"
_SPECK_M = 0.05
# Of a contact sensor: what it reports (the force), how contacts become one (their sum), how many it reports.
_CONTACT_FORCE, _NET_FORCE, _ONE = 1 << 1, 3, 1


@dataclass(frozen=True, eq=False)
class HostRobot:
    """A robot as C MuJoCo steps it.

    Attributes:
        spec: To which a world's solids are added.
        alone: The robot without any.
        rest: Its coordinates before it is placed at a start.
        rest_act: Its actuators' activations then.
        parts: Of the hull, for its clearance.
        physics_steps: In one control step.
    """

    spec: mujoco.MjSpec
    alone: mujoco.MjModel
    base: Base
    hull: Hull
    parts: tuple[HullPart, ...]
    rest: Float64[np.ndarray, "coordinates"]
    rest_act: Float64[np.ndarray, "activations"]
    physics_steps: int

    @property
    def actuators(self) -> int:
        """Returns how many numbers a control has."""
        return int(self.alone.nu)


def host_robot(path: Path) -> HostRobot:
    """Returns the robot of a ``robot.xml``.

    Raises:
        RobotRefused: It does not load, or cannot be driven about.
    """
    spec = read_robot_mjcf(path)
    _name_parts(spec)
    alone = compile_robot(spec)
    return HostRobot(
        spec=spec,
        alone=alone,
        base=base_of(alone),
        hull=hull_of(alone),
        parts=hull_parts(alone),
        rest=rest_position(alone),
        rest_act=np.array(alone.key_act[0] if alone.nkey else np.zeros(alone.na)),
        physics_steps=round(CONTROL_S / alone.opt.timestep),
    )


def world_models(robot: HostRobot, worlds: Mapping[str, World]) -> dict[str, mujoco.MjModel]:
    """Returns the robot's model in each world, all of the same sizes: worlds with fewer solids get specks far away.

    MuJoCo's state of one then fits all of them. Specks touch nothing and come last, so that a world's results are the
    same bits whatever worlds it is compiled with.
    """
    most = max((len(solids(world)) for world in worlds.values()), default=0)
    return {name: world_model(robot, world, most) for name, world in worlds.items()}


def world_model(robot: HostRobot, world: World, places: int = 0) -> mujoco.MjModel:
    """Returns a robot among all solids of a world, with at least so many places for solids.

    Its sensors are, for each physics step, the net force of the solids on the robot, then each actuator's force, then
    its speed.
    """
    spec = robot.spec.copy()
    bits = collision_bits(spec)
    body = spec.worldbody.add_body(name=_SOLIDS)
    given = solids(world)
    for solid in given:
        _add_solid(spec, body, solid, bits)
    for number in range(len(given), places):
        geom = add_obstacle(spec, f"{_SOLIDS}/{number}", mujoco.mjtGeom.mjGEOM_SPHERE, bits, body)
        geom.pos, geom.size = [PARKING_M, PARKING_M, -PARKING_M], [_SPECK_M] * 3
    _add_sensors(spec, robot)
    # A state that blows up stays as it is, and is reported, instead of starting anew.
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    return compile_robot(spec)


def _add_solid(spec: mujoco.MjSpec, body: mujoco.MjsBody, solid: Solid, bits: tuple[int, int]) -> None:
    kind = mujoco.mjtGeom.mjGEOM_BOX if solid.shape == "box" else mujoco.mjtGeom.mjGEOM_CYLINDER
    geom = add_obstacle(spec, f"solid/{solid.name}", kind, bits, body)
    x, y, z = solid.half_extents_m
    geom.pos = solid.center_m
    geom.size = [x, y, z] if solid.shape == "box" else [x, z, 0.0]
    geom.quat = [np.cos(solid.yaw_rad / 2), 0.0, 0.0, np.sin(solid.yaw_rad / 2)]


def _add_sensors(spec: mujoco.MjSpec, robot: HostRobot) -> None:
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    push = spec.add_sensor(name=_PUSH, type=mujoco.mjtSensor.mjSENS_CONTACT)
    push.objtype, push.objname = mujoco.mjtObj.mjOBJ_BODY, _SOLIDS
    push.reftype, push.refname = mujoco.mjtObj.mjOBJ_XBODY, robot.alone.body(robot.base.body).name
    push.intprm[:3] = [_CONTACT_FORCE, _NET_FORCE, _ONE]
    for prefix, kind in ((_FORCE, mujoco.mjtSensor.mjSENS_ACTUATORFRC), (_SPEED, mujoco.mjtSensor.mjSENS_ACTUATORVEL)):
        for actuator in spec.actuators:
            sensor = spec.add_sensor(name=f"{prefix}{actuator.name}", type=kind)
            sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_ACTUATOR, actuator.name


def _name_parts(spec: mujoco.MjSpec) -> None:
    """Names base and actuators that have no name: sensors refer to names."""
    for prefix, parts in (("base", spec.worldbody.bodies), ("actuator", spec.actuators)):
        for number, part in enumerate(parts):
            part.name = part.name or f"simyard/{prefix}/{number}"
