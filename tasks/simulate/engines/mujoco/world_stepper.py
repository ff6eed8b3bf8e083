"""Many robots, each among all solids of its world, stepped by C MuJoCo on the host's threads, in double precision.

All geoms are as they are, and so is the solver of the ``robot.xml``.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int
from mujoco.rollout import Rollout

from specs.data.episode import CONTROL_S
from specs.data.people import PERSON_HEIGHT_M, PERSON_RADIUS_M
from specs.data.world import Solid, World, solids
from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import (
    Base,
    Hull,
    add_obstacle,
    add_prism_mesh,
    base_of,
    collision_bits,
    compile_robot,
    coordinates_at,
    hull_of,
    no_log,
    pose_of,
    rest_position,
    velocity_of,
)
from tasks.simulate.application.varied_physics import AGAINST_MASS, WITH_MASS, WITH_STRENGTH, force_columns
from tasks.simulate.geometry.hull_outline import HullPart, hull_parts
from tasks.simulate.geometry.obstacles import PARKING_M

_SOLIDS = "simyard/solids"
_PUSH_SENSOR = "simyard/push"
_FORCE = "simyard/force/"
_SPEED = "simyard/speed/"
_PERSON = "simyard/person/"
_BOX = "simyard/box/"
_SPECK_M = 0.05
Sides = tuple[float, float, float]
_KINDS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "prism": mujoco.mjtGeom.mjGEOM_MESH,
}
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


def world_models(
    robot: HostRobot, worlds: Mapping[str, World], people: int = 0, boxes: Sequence[Sides] = ()
) -> dict[str, mujoco.MjModel]:
    """Returns the robot's model in each world, all of the same sizes: worlds with fewer solids get specks far away.

    MuJoCo's state of one then fits all of them. Specks touch nothing and come last, so that a world's results are the
    same bits whatever worlds it is compiled with.

    Args:
        robot: The robot.
        worlds: By name.
        people: How many have a place in each.
        boxes: How large those are that are put there.
    """
    most = max((len(solids(world)) for world in worlds.values()), default=0)
    return {name: world_model(robot, world, most, people, boxes) for name, world in worlds.items()}


def world_model(
    robot: HostRobot, world: World, places: int = 0, people: int = 0, boxes: Sequence[Sides] = ()
) -> mujoco.MjModel:
    """Returns a robot among all solids of a world.

    Its sensors are, for each physics step, the net force of the solids on the robot, then each actuator's force, then
    its speed, then each person's force on the robot, then each box's.

    Args:
        robot: The robot.
        world: The world.
        places: At least so many for solids.
        people: Likewise for people: bodies that are put where they stand, and that nothing moves.
        boxes: How large those are that are put there in the same way (m).
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
    for number in range(people):
        _add_person(spec, number, bits)
    for number, size_m in enumerate(boxes):
        _add_box(spec, number, size_m, bits)
    _add_sensors(spec, robot, [*(f"{_PERSON}{k}" for k in range(people)), *(f"{_BOX}{k}" for k in range(len(boxes)))])
    # A state that blows up stays as it is, and is reported, instead of starting anew.
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    return compile_robot(spec)


def varied_model(model: mujoco.MjModel, factors: tuple[float, float, float] | None) -> mujoco.MjModel:
    """Returns a model whose mass, friction and motor strength are so many times as large; the same where all are 1."""
    if factors is None or factors == (1.0, 1.0, 1.0):
        return model
    mass, friction, strength = factors
    varied = copy.copy(model)
    for name in WITH_MASS:
        getattr(varied, name)[:] *= mass
    for name in AGAINST_MASS:
        getattr(varied, name)[:] /= mass
    for name in WITH_STRENGTH:
        getattr(varied, name)[:] *= strength
    for name, scaled in force_columns(model).items():
        getattr(varied, name)[:] *= np.where(scaled, strength, 1.0)
    varied.geom_friction[:, 0] *= friction
    return varied


def _add_solid(spec: mujoco.MjSpec, body: mujoco.MjsBody, solid: Solid, bits: tuple[int, int]) -> None:
    name, (x, y, z) = f"solid/{solid.name}", solid.half_extents_m
    geom = add_obstacle(spec, name, _KINDS[solid.shape], bits, body)
    geom.pos = solid.center_m
    geom.size = [x, z, 0.0] if solid.shape == "cylinder" else [x, y, z]
    if solid.outline_m:
        add_prism_mesh(spec, name, np.array(solid.outline_m), z)
        geom.meshname = name
    geom.quat = [np.cos(solid.yaw_rad / 2), 0.0, 0.0, np.sin(solid.yaw_rad / 2)]


def _add_person(spec: mujoco.MjSpec, number: int, bits: tuple[int, int]) -> None:
    name, half_m = f"{_PERSON}{number}", PERSON_HEIGHT_M / 2
    body = spec.worldbody.add_body(name=name, mocap=True, pos=[PARKING_M + number, PARKING_M, half_m])
    geom = add_obstacle(spec, name, mujoco.mjtGeom.mjGEOM_CYLINDER, bits, body)
    geom.size = [PERSON_RADIUS_M, half_m, 0.0]


def _add_box(spec: mujoco.MjSpec, number: int, size_m: Sides, bits: tuple[int, int]) -> None:
    name, half_m = f"{_BOX}{number}", [side / 2 for side in size_m]
    body = spec.worldbody.add_body(name=name, mocap=True, pos=[-PARKING_M - 10.0 * number, PARKING_M, half_m[2]])
    geom = add_obstacle(spec, name, mujoco.mjtGeom.mjGEOM_BOX, bits, body)
    geom.size = half_m


def _add_sensors(spec: mujoco.MjSpec, robot: HostRobot, moved: Sequence[str]) -> None:
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    _add_push_sensor(spec, robot, _PUSH_SENSOR, _SOLIDS)
    for prefix, kind in ((_FORCE, mujoco.mjtSensor.mjSENS_ACTUATORFRC), (_SPEED, mujoco.mjtSensor.mjSENS_ACTUATORVEL)):
        for actuator in spec.actuators:
            sensor = spec.add_sensor(name=f"{prefix}{actuator.name}", type=kind)
            sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_ACTUATOR, actuator.name
    for name in moved:
        _add_push_sensor(spec, robot, name, name)


def _add_push_sensor(spec: mujoco.MjSpec, robot: HostRobot, name: str, body: str) -> None:
    """Adds what reads the net force of a body on the robot."""
    push = spec.add_sensor(name=name, type=mujoco.mjtSensor.mjSENS_CONTACT)
    push.objtype, push.objname = mujoco.mjtObj.mjOBJ_BODY, body
    push.reftype, push.refname = mujoco.mjtObj.mjOBJ_XBODY, robot.alone.body(robot.base.body).name
    push.intprm[:3] = [_CONTACT_FORCE, _NET_FORCE, _ONE]


def _name_parts(spec: mujoco.MjSpec) -> None:
    """Names base and actuators that have no name: sensors refer to names."""
    for prefix, parts in (("base", spec.worldbody.bodies), ("actuator", spec.actuators)):
        for number, part in enumerate(parts):
            part.name = part.name or f"simyard/{prefix}/{number}"


_STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
_TIME = 1  # comes first in a state, then qpos, qvel and act
_PUSH_NUMBERS = 3
_CONTROLS = mujoco.mjtState.mjSTATE_CTRL
_AMONG_PEOPLE = _CONTROLS | mujoco.mjtState.mjSTATE_MOCAP_POS
# MuJoCo calls numbers beyond this bad and stops stepping (mjMAXVAL).
_MOST = 1e10


# ``mujoco.rollout`` steps them: measured against a thread pool that calls ``mj_step``, it takes a tenth less time,
# and gives each physics step's sensor values, of which impulse and energy are summed up (docs/reference/engines.md).
class HostBody(NamedTuple):
    """The robots' mechanical states as the applications get them; fields as in ``application.motion.Body``."""

    qpos: Float32[np.ndarray, "lanes 3"]
    qvel: Float32[np.ndarray, "lanes 3"]
    act: Float32[np.ndarray, "lanes activations"]
    joints: tuple[Float32[np.ndarray, "lanes coordinates"], Float32[np.ndarray, "lanes speeds"]] | None


class HostWork(NamedTuple):
    """What a control step's physics did; fields as in ``application.motion.Work``, and what people pushed with."""

    impulse_ns: Float32[np.ndarray, "lanes"]
    push_ns: Float32[np.ndarray, "lanes 2"]
    energy_j: Float32[np.ndarray, "lanes"]
    people_ns: Float32[np.ndarray, "lanes"]


class Stepper:
    """The robots of a chunk; what one of them does depends neither on the others nor on the number of threads.

    Args:
        robot: What they all are.
        models: Each lane's, all of the same sizes (``world_models``).
        starts: Each lane's (x m, y m, yaw rad).
        threads: To step them on.
        boxes: How large those are that are put there (``world_models``).
    """

    def __init__(
        self,
        robot: HostRobot,
        models: Sequence[mujoco.MjModel],
        starts: Float[np.ndarray, "lanes 3"],
        threads: int,
        boxes: Sequence[Sides] = (),
    ) -> None:
        self._boxes_half_m = np.array([size_m[2] / 2 for size_m in boxes])
        self._robot, self._models = robot, list(models)
        self._pool = Rollout(nthread=threads if threads > 1 else 0)
        # Of the model with most parts of meshes: MuJoCo clears as many marks in them as the model at hand has parts.
        self._largest = max(models, key=lambda model: int(model.nbvh))
        self._datas = [mujoco.MjData(self._largest) for _ in range(threads)]
        first = models[0]
        self._qpos = slice(_TIME, _TIME + first.nq)
        self._qvel = slice(self._qpos.stop, self._qpos.stop + first.nv)
        self._act = slice(self._qvel.stop, self._qvel.stop + first.na)
        self._states = self._initial(starts.astype(np.float64))
        self._warmstarts = np.zeros((len(models), first.nv))

    def body(self) -> HostBody:
        """Returns all robots as they are."""
        qpos, qvel, base = self._states[:, self._qpos], self._states[:, self._qvel], self._robot.base
        joints = (_single(qpos), _single(qvel)) if base.articulated else None
        pose, velocity = pose_of(base, qpos, np), velocity_of(base, qpos, qvel, np)
        return HostBody(_single(pose), _single(velocity), _single(self._states[:, self._act]), joints)

    @np.errstate(over="ignore", invalid="ignore")  # a state that blows up is a row
    def drive(
        self,
        controls: Float[np.ndarray, "lanes actuators"],
        moving: Bool[np.ndarray, "lanes"],
        people_m: Float[np.ndarray, "lanes people 2"] | None = None,
        boxes_m: Float[np.ndarray, "lanes boxes 2"] | None = None,
    ) -> tuple[HostBody, HostWork]:
        """Returns the robots a control step later, and what was done; those that are not moving stay as they are.

        Args:
            controls: Of each lane.
            moving: Which lanes are driven.
            people_m: Where people stand meanwhile (x, y), as many as the models have; None without any.
            boxes_m: Where boxes stand, the models' first; likewise.
        """
        chosen = np.flatnonzero(moving)
        work = HostWork(*(np.zeros((len(moving), *shape), np.float32) for shape in ((), (2,), (), ())))
        if len(chosen):
            given = controls[chosen].astype(np.float64)
            if people_m is not None:
                given = _beside(given, people_m[chosen], np.full(people_m.shape[1], PERSON_HEIGHT_M / 2))
            if boxes_m is not None:
                given = _beside(given, boxes_m[chosen, : len(self._boxes_half_m)], self._boxes_half_m)
            path, sensed = self._rolled_out(chosen, given)
            self._warmstarts[chosen] = self._accelerations(np.concatenate([self._states[chosen, None], path], axis=1))
            self._states[chosen] = path[:, -1]
            # MuJoCo would take a control that it calls bad for 0, and say so in a log.
            self._states[chosen[(np.abs(controls[chosen]) > _MOST).any(axis=1)]] = np.nan
            for total, done in zip(work, self._work(sensed), strict=True):
                total[chosen] = done
        return self.body(), work

    def place(self, lanes: Int[np.ndarray, "chosen"], poses: Float[np.ndarray, "chosen 3"]) -> None:
        """Sets some robots at rest at poses (x m, y m, yaw rad); their time goes on."""
        times = self._states[lanes, _TIME - 1]
        self._states[lanes] = self._initial(poses.astype(np.float64))
        self._states[lanes, _TIME - 1], self._warmstarts[lanes] = times, 0.0

    def _initial(self, starts: Float64[np.ndarray, "lanes 3"]) -> Float64[np.ndarray, "lanes state"]:
        model, data = self._largest, self._datas[0]
        mujoco.mj_resetData(model, data)
        state = np.empty(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(model, data, state, _STATE)
        states = np.tile(state, (len(starts), 1))
        states[:, self._qpos] = coordinates_at(self._robot.base, self._robot.rest, starts, np)
        states[:, self._act] = self._robot.rest_act
        return states

    def _rolled_out(
        self, chosen: Int[np.ndarray, "chosen"], given: Float64[np.ndarray, "chosen numbers"]
    ) -> tuple[Float64[np.ndarray, "chosen steps state"], Float64[np.ndarray, "chosen steps sensors"]]:
        """Returns the states after each physics step of a control step, and what the sensors read in it.

        Args:
            chosen: The lanes.
            given: Their controls, then where people stand in them.
        """
        kind = _AMONG_PEOPLE if given.shape[1] > self._robot.actuators else _CONTROLS
        steps = self._robot.physics_steps
        states = np.empty((len(chosen), steps, self._states.shape[1]))
        sensed = np.empty((len(chosen), steps, self._models[0].nsensordata))
        with no_log():
            self._pool.rollout(
                [self._models[lane] for lane in chosen],
                self._datas,
                self._states[chosen],
                np.repeat(given[:, None], steps, axis=1),
                control_spec=int(kind),
                skip_checks=True,
                nstep=steps,
                initial_warmstart=self._warmstarts[chosen],
                state=states,
                sensordata=sensed,
            )
        return states, sensed

    def _accelerations(self, path: Float64[np.ndarray, "chosen states state"]) -> Float64[np.ndarray, "chosen speeds"]:
        """Returns the last step's accelerations, which the solver starts from in the next one."""
        return (path[:, -1, self._qvel] - path[:, -2, self._qvel]) / self._models[0].opt.timestep

    def _work(self, sensed: Float64[np.ndarray, "chosen steps sensors"]) -> HostWork:
        step_s, forces = self._models[0].opt.timestep, self._robot.actuators
        push_n = sensed[:, :, :2]
        ends = np.cumsum([_PUSH_NUMBERS, forces, forces])
        _, forces_n, speeds, own = np.split(sensed, ends, axis=2)
        moved_n = own.reshape(*own.shape[:2], -1, _PUSH_NUMBERS)[..., :2]
        boxes = len(self._boxes_half_m)
        people = moved_n.shape[2] - boxes
        people_n = moved_n[:, :, :people].sum(axis=2)
        if boxes:  # solids as all others
            push_n = push_n + moved_n[:, :, people:].sum(axis=2)
        powers_w = forces_n * speeds
        return HostWork(
            _single(np.hypot(push_n[:, :, 0], push_n[:, :, 1]).sum(axis=1) * step_s),
            _single((push_n + people_n if own.size else push_n).sum(axis=1) * step_s),
            _single(np.abs(powers_w).sum(axis=(1, 2)) * step_s),
            _single(np.hypot(people_n[:, :, 0], people_n[:, :, 1]).sum(axis=1) * step_s),
        )


def _beside(
    controls: Float64[np.ndarray, "chosen numbers"],
    places_m: Float[np.ndarray, "chosen moved 2"],
    middles_m: Float64[np.ndarray, "moved"],
) -> Float64[np.ndarray, "chosen numbers"]:
    """Returns controls, and behind them where bodies stand (x, y, z)."""
    heights = np.broadcast_to(middles_m[:, None], (*places_m.shape[:2], 1))
    standing = np.concatenate([places_m.astype(np.float64), heights], axis=2)
    return np.concatenate([controls, standing.reshape(len(controls), -1)], axis=1)


def _single(values: Float64[np.ndarray, "*shape"]) -> Float32[np.ndarray, "*shape"]:
    """Returns values for the applications; what MuJoCo calls bad is no number."""
    return np.where(np.abs(values) < _MOST, values, np.nan).astype(np.float32)
