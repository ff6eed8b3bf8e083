"""The program of a task: its robot on a compiled engine, its pool of episodes, what a trainer sees and is paid."""

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import jax.numpy as jnp

from specs.data.episode import ApplicationLaunch, EpisodeRequest
from specs.data.world import World
from tasks.simulate.application.code import load_factory
from tasks.simulate.engine.mjx.engine import mjx_mechanics
from tasks.simulate.engine.planar.engine import planar_mechanics
from tasks.simulate.engine.program import lane_mesh, padded_lanes, with_stand_in
from tasks.simulate.host.controller_kind import controller_kind
from tasks.simulate.host.controllers import HostBundle
from tasks.simulate.host.kinds import HOST_KINDS
from tasks.simulate.lane.calls import Applications
from tasks.simulate.lane.step import Mechanics
from tasks.simulate.plan.chunks import split_environment
from tasks.simulate.refusal import RobotRefused
from tasks.simulate.sensor.sensors import Sensors, read_sensors
from tasks.simulate.training.action import ActionMap, action_map
from tasks.simulate.training.episode_pool import StagedPool, stage_pool
from tasks.simulate.training.observation import FieldBounds, default_fields, field_bounds
from tasks.simulate.training.reward import Reward, progress
from tasks.simulate.training.vector_program import LaneKernels, VectorProgram, vector_program

TrainingEngine = Literal["auto", "planar", "mjx"]
# Engines whose step is compiled, fastest first: C MuJoCo steps lanes one by one on the host.
_MECHANICS: Mapping[str, Callable[[Path], Mechanics]] = {"planar": planar_mechanics, "mjx": mjx_mechanics}
_PROGRAMS_KEPT = 8


@dataclass(frozen=True)
class Task:
    """What is trained on; two tasks are the same if their bundles' digests, episodes and worlds are.

    Attributes:
        robot: Folder of the robot's bundle.
        scenario: Folder of the scenario's.
        requests: The pool's episodes, which share a program; their launches name the packages in the bundles.
        worlds: Of the episodes, with their names.
        sensors: An object with the robot's sensors as attributes; None for those that its application declares.
    """

    robot: Path
    scenario: Path
    requests: tuple[EpisodeRequest, ...]
    worlds: tuple[tuple[str, World], ...]
    sensors: object | None = None

    def __hash__(self) -> int:
        """Returns a hash of what tells tasks apart at once."""
        return hash((self.robot, self.scenario, len(self.requests), tuple(name for name, _ in self.worlds)))


class View(NamedTuple):
    """What a trainer sees, gives and is paid.

    Attributes:
        fields: Of the observation; None for what a reactive controller needs.
        normalized: Whether actions go from -1 to 1.
        reward: A function in JAX of one lane's step.
    """

    fields: tuple[str, ...] | None = None
    normalized: bool = True
    reward: Reward = progress


@dataclass(frozen=True, eq=False)
class TrainingProgram:
    """All that lanes share with those of another environment of the same task.

    Attributes:
        lanes: How many there are at least, so that they fill whole vectors on each device.
    """

    pool: StagedPool
    sensors: Sensors
    actions: ActionMap
    bounds: Mapping[str, FieldBounds]
    compiled: VectorProgram
    lanes: int


def training_program(
    task: Task, view: View, count: int, *, autoreset: bool, engine: TrainingEngine = "auto"
) -> TrainingProgram:
    """Returns the program of a task; compiles nothing yet.

    Args:
        task: What is trained on.
        view: What a trainer sees, gives and is paid.
        count: How many lanes.
        autoreset: Whether a lane that is done begins its next episode in the step after.
        engine: One that is compiled; ``auto`` for the first that can represent the robot.

    Raises:
        BundleCrash: An application does not import, or its scenario finds no start and goals.
        RobotRefused: No engine that is compiled can represent the robot.
        DocumentError: The robot's observation has no such field, or it has nothing to drive it with.
    """
    return _program(task, view, padded_lanes(count, lane_mesh().size), autoreset, engine)


@functools.lru_cache(maxsize=_PROGRAMS_KEPT)
def _program(task: Task, view: View, lanes: int, autoreset: bool, engine: TrainingEngine) -> TrainingProgram:  # noqa: FBT001 - a part of a key
    """Returns a program; kept, so that environments of one task share a pool and a compilation."""
    robot = task.robot / "robot.xml"
    mechanics = _mechanics(robot, engine)
    applications = _applications(task, mechanics.actuators)
    pool = stage_pool(applications, mechanics.hull, task.requests, dict(task.worlds))
    joints = mechanics.first_body(jnp.zeros(3)).joints
    actions = action_map(robot, normalized=view.normalized)
    fields = default_fields(applications.sensors) if view.fields is None else view.fields
    bounds = field_bounds(fields, applications.sensors, joints, pool.bounds)
    kernels = LaneKernels(mechanics, applications, actions, bounds, view.reward, autoreset)
    compiled = vector_program(kernels, lane_mesh())
    return TrainingProgram(pool, applications.sensors, actions, bounds, compiled, lanes)


def _mechanics(robot: Path, engine: TrainingEngine) -> Mechanics:
    refusals: list[str] = []
    for name in _MECHANICS if engine == "auto" else (engine,):
        try:
            return _MECHANICS[name](robot)
        except RobotRefused as refused:
            refusals.append(str(refused))
    raise RobotRefused("\n".join(dict.fromkeys(refusals)))


def _applications(task: Task, actuators: int) -> Applications:
    """Returns the applications, with a stand-in for the controller that has its sensors."""
    first = task.requests[0]
    numbers, texts = split_environment(first.environment)
    make_scenario = load_factory(task.scenario, first.scenario, "scenario", "SimulationApplicationCrash")
    declare = (lambda _: task.sensors) if task.sensors is not None else _declaration(task.robot, first.robot)
    sensors = read_sensors(declare, {**texts, **{name: jnp.float32(value) for name, value in numbers.items()}})
    names = tuple(sorted(numbers))
    return with_stand_in(Applications(declare, make_scenario, texts, names, sensors), actuators, host=True)


def _declaration(folder: Path, launch: ApplicationLaunch) -> Callable[..., object]:
    """Returns what makes an object with a robot application's sensors, however it is driven."""
    bundle = HostBundle(folder, launch)
    kind = controller_kind(*bundle)
    if kind in HOST_KINDS:
        return HOST_KINDS[kind](bundle).declare
    return load_factory(*bundle, "controller", "RobotApplicationCrash")
