"""The mujoco engine: C MuJoCo on the host's threads among all solids of each lane's world, for any robot.

Sensors, controller and scenario are the same JAX functions as on the other engines, over all lanes at once; between the
two halves of a control step C MuJoCo drives those lanes that are not done.
"""

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float

from specs.data.world import World
from specs.pipeline.simulation_section import EngineName
from tasks.simulate.application.contract import Joints, Observation, State
from tasks.simulate.application.motion import Body, Motion, Work
from tasks.simulate.application.robot_mjcf import Hull
from tasks.simulate.devices import device_count
from tasks.simulate.engine.mujoco.model import HostRobot, host_robot, world_models
from tasks.simulate.engine.mujoco.stepper import HostBody, Stepper
from tasks.simulate.engine.program import (
    lane_mesh,
    padded_lanes,
    put_lanes,
    split_over,
    stacked_records,
    strong_types,
    with_stand_in,
)
from tasks.simulate.host.controllers import HostApplication, HostControllers, HostStart
from tasks.simulate.lane.calls import Applications
from tasks.simulate.lane.lane_state import Decision, LaneInputs, LaneState, StepRecord, begin_lane
from tasks.simulate.lane.sense import decide, observe
from tasks.simulate.lane.settle import settle
from tasks.simulate.lane.staging import Lane
from tasks.simulate.plan.chunks import SLICE_STEPS
from tasks.simulate.surroundings.hull_distance import hull_distance_m
from tasks.simulate.surroundings.hull_outline import HullPart

# Those parts of a controller's state that a step changed, by place: what it hands on, such as a plan, stays put.
Changed = dict[int, Array]
# What the controllers changed, their controls, and the scans that they saw, lanes first.
Decided = tuple[Changed, Float[Array, "lanes actuators"], Float[Array, "lanes rays"]]


@dataclass(frozen=True, eq=False)
class HostProgram:
    """A robot and its applications on C MuJoCo; see ``tasks.simulate.engine.program.Program``.

    Attributes:
        begin: Returns the lanes' state before the first control step.
        sense: Returns what the robots sense, for controllers that are plain Python.
        decide: Returns what the controllers change of their states, their controls, and what they saw.
        settle: Returns the lanes after a control step that was decided and driven; the state given is used up.
        host: The robot application, if it runs on the host.
    """

    robot: HostRobot
    applications: Applications
    lanes: int
    threads: int
    mesh: Mesh
    begin: Callable[[LaneInputs, Body], LaneState]
    sense: Callable[[LaneInputs, LaneState], Observation]
    decide: Callable[[LaneInputs, LaneState], Decided]
    settle: Callable[[LaneInputs, LaneState, Decided, Body, Work], tuple[LaneState, StepRecord]]
    host: HostApplication | None
    engine: EngineName = "mujoco"

    @property
    def hull(self) -> Hull:
        """Returns the robot's hull."""
        return self.robot.hull

    @property
    def actuators(self) -> int:
        """Returns how many numbers a control has."""
        return self.robot.actuators

    def body(self) -> Body:
        """Returns a robot at rest, to check applications with."""
        stepper = Stepper(self.robot, [self.robot.alone], np.zeros((1, 3)), 1)
        return _body(jax.tree.map(lambda array: array[0], stepper.body()))

    def ready(self, inputs: LaneInputs, lanes: Sequence[Lane], worlds: Mapping[str, World]) -> "HostRun":
        """Returns episodes ready to run."""
        models = world_models(self.robot, {lane.request.world: worlds[lane.request.world] for lane in lanes})
        filled = [*lanes, *[lanes[0]] * (self.lanes - len(lanes))]
        each = [models[lane.request.world] for lane in filled]
        stepper = Stepper(self.robot, each, np.asarray(inputs.start), self.threads)
        controllers = None
        if self.host is not None:
            controllers = self.host.start(HostStart(lanes, self.lanes, self.actuators, self.applications.sensors))
        return HostRun(self, put_lanes(self.mesh, inputs), stepper, controllers)


@dataclass(frozen=True, eq=False)
class HostRun:
    """Episodes on C MuJoCo; see ``tasks.simulate.engine.program.Run``. It runs once."""

    program: HostProgram
    inputs: LaneInputs
    stepper: Stepper
    host: HostControllers | None

    def begin(self) -> LaneState:
        """Returns the lanes before the first control step."""
        return self.program.begin(self.inputs, _body(self.stepper.body()))

    def advance(self, state: LaneState) -> tuple[LaneState, StepRecord]:
        """Returns the lanes a slice later, or when all are done, and the records up to then."""
        records: list[StepRecord] = []
        while len(records) < SLICE_STEPS:
            moving = ~np.asarray(state.done)
            if records and not moving.any():
                break
            decided = self._decided(state, moving)
            body, work = self.stepper.drive(np.asarray(decided[1]), moving)
            state, record = self.program.settle(self.inputs, state, decided, _body(body), Work(*_arrays(work)))
            records.append(jax.tree.map(np.asarray, record))
        return state, stacked_records(records)

    def _decided(self, state: LaneState, moving: Bool[np.ndarray, "lanes"]) -> Decided:
        if self.host is None:
            return self.program.decide(self.inputs, state)
        observed = jax.tree.map(np.asarray, self.program.sense(self.inputs, state))
        return {}, jnp.asarray(self.host.controls(observed, moving)), jnp.asarray(observed.ranges_m)


def host_program(
    path: Path,
    applications: Applications,
    lanes: int,
    host: HostApplication | None = None,
    *,
    threads: int | None = None,
) -> HostProgram:
    """Returns the program of a robot and its applications; compiles nothing yet.

    Args:
        path: The ``robot.xml``.
        applications: The robot application and the scenario.
        lanes: At least so many.
        host: The robot application, if it runs on the host.
        threads: To step robots on; one for each core if None.

    Raises:
        RobotRefused: It does not load, or cannot be driven about.
    """
    robot, mesh = host_robot(path), lane_mesh()
    seen = with_stand_in(applications, robot.actuators, host=host is not None)

    def split(kernel: Callable[..., object], arguments: int) -> Callable[..., object]:
        return split_over(mesh, jax.vmap(functools.partial(kernel, seen)), arguments)

    return HostProgram(
        robot=robot,
        applications=seen,
        lanes=padded_lanes(lanes, mesh.size),
        threads=threads or device_count(),
        mesh=mesh,
        begin=jax.jit(split(_begin_lane, 2)),
        sense=jax.jit(split(observe, 2)),
        decide=jax.jit(split(_decide_lane, 2)),
        settle=jax.jit(split(functools.partial(_settle_lane, robot.parts), 5), donate_argnums=1),
        host=host,
    )


def _begin_lane(applications: Applications, inputs: LaneInputs, body: Body) -> LaneState:
    return strong_types(begin_lane(applications, inputs, body))


def _decide_lane(applications: Applications, inputs: LaneInputs, state: LaneState) -> Decided:
    after, control, ranges_m = decide(applications, inputs, state)
    before = jax.tree.leaves(state.controller)
    changed = {place: leaf for place, leaf in enumerate(jax.tree.leaves(after)) if leaf is not before[place]}
    return changed, control, ranges_m


def _settle_lane(  # noqa: PLR0917 - as the program maps it
    parts: tuple[HullPart, ...],
    applications: Applications,
    inputs: LaneInputs,
    state: LaneState,
    decided: Decided,
    body: Body,
    work: Work,
) -> tuple[LaneState, StepRecord]:
    changed, control, ranges_m = decided
    clearance_m = hull_distance_m(parts, inputs.boxes, inputs.cylinders, body.qpos)
    kept = _with_changes(state.controller, changed)
    return settle(applications, inputs, state, Decision(kept, control, ranges_m), Motion(body, work, clearance_m))


def _with_changes(before: State, changed: Changed) -> State:
    leaves, form = jax.tree.flatten(before)
    return jax.tree.unflatten(form, [changed.get(place, leaf) for place, leaf in enumerate(leaves)])


def _body(host: HostBody) -> Body:
    joints = None if host.joints is None else Joints(*_arrays(host.joints))
    pose, velocity, act, warmstart = _arrays((*host[:3], np.zeros((*host.qpos.shape[:-1], 0), np.float32)))
    return Body(pose, velocity, act, warmstart, joints)


def _arrays(host: Iterable[np.ndarray]) -> tuple[jax.Array, ...]:
    return tuple(jnp.asarray(array) for array in host)
