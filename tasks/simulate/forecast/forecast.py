"""The forecast of a batch: its engines, chunks, time and memory, in general found without importing JAX.

The choice of a robot's engine is kept in the user's cache folder, because to make it anew imports MuJoCo. What is
remembered is good for the same bundle and the same code. Nothing of it is ever part of a result: a batch that runs
chooses anew. A folder that cannot be written to is as good as no memory at all.

What ROS nodes cost was measured with rospy nodes that answer each scan on two cores: 375 control steps a second with
one lane, 740 in all with 8, 620 with 32; 1.3, 2.3 and 6.5 s until they are ready; 32 to 42 MB a process. A node in C++
takes 2 MB.
"""

import functools
import hashlib
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from specs.base import Spec
from specs.data.episode import CONTROL_HZ, PHYSICS_HZ, ApplicationLaunch, EpisodeRequest
from specs.field_types import EngineName
from specs.launched_file import policy_file
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.chunk.byproducts import recall_engine_timings, recall_timings
from tasks.simulate.devices import DeviceKind, device_count, device_kind
from tasks.simulate.engines.engine_table import ENGINES, REFERENCE, EngineChoice, choose_engine
from tasks.simulate.forecast.batch_timing import (
    Span,
    Speed,
    compiling_s,
    driving_s,
    memory_bytes,
    probed_speed,
    recall_batches,
    remembered_speed,
    remembered_wall_s,
)
from tasks.simulate.host.declaration import ControllerKind, controller_kind
from tasks.simulate.host.policy_check import check_policy
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.chunks import program_key
from tasks.simulate.plan.episode_layout import Layout
from tasks.storage.base.local_files import cache_folder, whole_file

# Of a lane alone, and of each of many that share the cores.
_STEP_S, _LANE_STEP_S = 2.7e-3, 1.5e-3
_MEASURED_CORES = 2
_READY_S, _LANE_READY_S = 1.2, 0.17
_NODE_BYTES = 42_000_000
# Nodes that wait for single messages take 10 times as long; in C++ they take half.
_LOW, _HIGH = 0.2, 1.5


def node_bytes() -> int:
    """Returns the memory of a Python node, as far as it shares none with others."""
    return _NODE_BYTES


def nodes_pace(lanes: int, nodes: int) -> Span:
    """Returns how many control steps a second all lanes go in all, with so many nodes each."""
    expected = lanes / _step_s(lanes, nodes)
    return Span(low=_LOW * expected, high=_HIGH * expected)


def nodes_s(episodes: int, lanes: int, steps: int, nodes: int = 1) -> Span:
    """Returns the wall seconds that nodes add to a batch of so many episodes of so many control steps at most."""
    chunks = -(-episodes // lanes)
    ready_s = chunks * (_READY_S + _LANE_READY_S * min(lanes, episodes) * nodes)
    drive_s = chunks * steps * _step_s(min(lanes, episodes), nodes)
    return Span(low=0.3 * (ready_s + drive_s), high=ready_s / _LOW + drive_s / _LOW)


def _step_s(lanes: int, nodes: int) -> float:
    slower = max(1.0, _MEASURED_CORES / (os.cpu_count() or 1))
    return max(_STEP_S, _LANE_STEP_S * lanes * nodes * slower)


logger = logging.getLogger(__name__)
_CODE = Path(__file__).parents[1]


class EngineAnswer(Spec):
    """The engine of a robot application, or why there is none.

    Attributes:
        choice: None if no engine takes the robot.
        refusal: Why none does, with the remedies; or empty.
    """

    choice: EngineChoice | None
    refusal: str = ""


def recall_choice(asked: str, digest: str, robot: Path, controller: ControllerKind, device: DeviceKind) -> EngineAnswer:
    """Returns which engine runs a robot application.

    Args:
        asked: ``auto``, or the engine that it must be.
        digest: Of its bundle, which holds all that ``robot.xml`` refers to.
        robot: Its ``robot.xml``.
        controller: How it is driven.
        device: What JAX will run on.
    """
    path = _choice_file([asked, digest, device, controller, *_contents((robot,)), *_code()])
    try:
        return EngineAnswer.model_validate_json(path.read_bytes())
    except (OSError, ValidationError):
        answer = _chosen(asked, robot, controller, device)
    try:
        with whole_file(path) as file:
            file.write(answer.model_dump_json().encode())
    except OSError as exc:
        logger.debug("the engine is not remembered: %s", exc)
    return answer


def _chosen(asked: str, robot: Path, controller: ControllerKind, device: DeviceKind) -> EngineAnswer:
    try:
        return EngineAnswer(choice=choose_engine(asked, robot, controller, device))
    except RobotRefused as refused:
        return EngineAnswer(choice=None, refusal=str(refused))


def _contents(files: Sequence[Path]) -> Iterator[str]:
    for file in files:
        yield hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else ""


def _code() -> Iterator[str]:
    """Yields what changes when an engine does: MuJoCo's version, and the size and age of each module here."""
    yield version("mujoco")
    for module in sorted(_CODE.rglob("*.py")):
        stat = module.stat()
        yield f"{module.relative_to(_CODE)} {stat.st_size} {stat.st_mtime_ns}"


def _choice_file(parts: Sequence[str]) -> Path:
    return cache_folder() / "engines" / f"{hashlib.sha256(repr(parts).encode()).hexdigest()}.json"


Basis = Literal["this very program", "other programs", "nothing"]
# From what is known best.
_BASES: Sequence[Basis] = ("this very program", "other programs", "nothing")
# Importing JAX and Prefect, the server's start, and for each episode its row in chunk and tables.
_NODES = ("ros", "ros2")
_START_S = Span(low=4.0, high=12.0)
_ROW_S = Span(low=0.2e-3, high=1e-3)


class RobotPlan(Spec):
    """What is going to drive a robot application.

    Attributes:
        robot: The application's name; where a batch has several of it, with what tells them apart, such as the version.
        choice: Its engine and why; None if none takes the robot.
        refusal: Why none does, with the remedies; or empty.
    """

    robot: str
    choice: EngineChoice | None
    refusal: str = ""


class EnginePlan(Spec):
    """How a batch is going to be simulated.

    Attributes:
        episodes: How many there are.
        robots: What drives each robot application.
        device: The kind of device that JAX will run on.
        devices: Host devices that share the lanes.
        lanes: Lanes of a chunk.
        chunks: Runs of compiled programs.
        compilations: Different programs; worlds, seeds and numeric variables add none.
        audited: Episodes that are driven again at the end.
        lane_steps_at_most: Physics steps of all lanes, if every episode took its full duration.
        wall_s: From the command to the batch's tables and audit.
        memory_bytes: The most that the process holds.
        known_from: What on this machine the two were told from, of the program that is known least.
    """

    episodes: int
    robots: tuple[RobotPlan, ...]
    device: DeviceKind
    devices: int
    lanes: int
    chunks: int
    compilations: int
    audited: int
    lane_steps_at_most: int
    wall_s: Span
    memory_bytes: Span
    known_from: Basis


def engine_plan(plan: BatchPlan, folders: Mapping[str, Path]) -> EnginePlan:
    """Returns how a batch would be simulated.

    Args:
        plan: The batch.
        folders: Unpacked folders of its applications, by digest.
    """
    layout, kind = Layout(plan), device_kind()
    launches = _robots(plan)
    controllers: dict[ApplicationLaunch, ControllerKind] = {
        launch: controller_kind(folders[launch.digest], launch) for launch in launches
    }
    choices = {launch: _robot(plan.engine, launch, folders, kind, _label(launch, launches)) for launch in launches}
    programs = [
        _Program(request, episodes, choice.engine, kind, plan.lanes, controller=controllers[request.robot])
        for request, episodes in layout.programs()
        if (choice := choices[request.robot].choice)
    ]
    longest_s = max((template.duration_s for template in plan.templates), default=0.0)
    audited = min(plan.audit, layout.episodes) if programs else 0
    return EnginePlan(
        episodes=layout.episodes,
        robots=tuple(choices.values()),
        device=kind,
        devices=device_count(),
        lanes=plan.lanes,
        chunks=layout.chunks,
        compilations=len(layout.programs()),
        audited=audited,
        lane_steps_at_most=_lane_steps(plan),
        wall_s=_remembered_wall_s(plan, programs, layout.episodes)
        or _wall_s(programs, layout.episodes, plan.lanes, longest_s, audited),
        memory_bytes=_most(programs, plan.lanes, audited),
        known_from=_BASES[max((_BASES.index(each.basis) for each in programs), default=-1)],
    )


class _Program:
    """A program of a batch, and what is known of its speed."""

    def __init__(
        self,
        request: EpisodeRequest,
        episodes: int,
        engine: EngineName,
        device: DeviceKind,
        lanes: int,
        *,
        controller: ControllerKind,
    ) -> None:
        self.device: DeviceKind = device
        self.engine: EngineName = engine
        self.request, self.episodes = request, episodes
        self.controller: ControllerKind = controller
        self.speed: Speed
        self.basis: Basis
        self.speed, self.basis = _speed(request, engine, device, lanes, host=controller != "jax")

    def reference(self, lanes: int) -> "_Program":
        """Returns the program that audits it."""
        return _Program(self.request, self.episodes, REFERENCE, self.device, lanes, controller=self.controller)

    def wall_s(self, episodes: int, lanes: int, longest_s: float, *, compiled: bool = False) -> Span:
        """Returns what some of its episodes take, with so many lanes, and the program if it is not there."""
        chunks = -(-episodes // lanes)
        drive = driving_s(self.engine, self.speed, episodes=episodes, lanes=lanes, chunks=chunks, duration_s=longest_s)
        if self.basis == "nothing" and self.controller in _NODES:
            drive = drive.plus(nodes_s(episodes, lanes, round(longest_s * CONTROL_HZ)))
        return drive if compiled else drive.plus(compiling_s(self.engine, self.speed))


def _speed(
    request: EpisodeRequest, engine: EngineName, device: DeviceKind, lanes: int, *, host: bool
) -> tuple[Speed, Basis]:
    own = [each for each in recall_timings(program_key(request)) if (each.engine, each.device) == (engine, device)]
    if (speed := remembered_speed(own, lanes, same_program=True)) is not None:
        return speed, "this very program"
    speed = _speed_of_engine(engine, device, lanes, cache_folder(), host=host)
    return (speed, "other programs") if speed is not None else (probed_speed(device_count()), "nothing")


@functools.cache
def _speed_of_engine(engine: EngineName, device: DeviceKind, lanes: int, _cache: Path, *, host: bool) -> Speed | None:
    """Returns what programs of an engine took; read once for each cache folder, however many programs a batch has."""
    return remembered_speed(recall_engine_timings(engine, device, host=host), lanes, same_program=False)


def _robots(plan: BatchPlan) -> list[ApplicationLaunch]:
    return list(dict.fromkeys(template.robot for template in plan.templates))


def _label(launch: ApplicationLaunch, launches: Sequence[ApplicationLaunch]) -> str:
    """Returns the name of a robot application, with what no other of that name in the batch has."""
    namesakes = [each for each in launches if each.name == launch.name]

    def parts(each: ApplicationLaunch) -> tuple[str, str, str, str]:
        architecture = each.architecture or "every architecture"
        return f"version {each.version}", architecture, f"{each.package}/{each.launch_file}", each.digest[:8]

    columns = zip(*map(parts, namesakes), strict=True)
    told = [part for part, column in zip(parts(launch), columns, strict=True) if len(set(column)) > 1]
    if len(told) > 1:  # another version has another digest, which says nothing more
        told = [part for part in told if part != launch.digest[:8]]
    return " ".join([launch.name, *told])


def _robot(
    asked: str, launch: ApplicationLaunch, folders: Mapping[str, Path], kind: DeviceKind, label: str
) -> RobotPlan:
    folder = folders[launch.digest]
    controller = controller_kind(folder, launch)
    if controller == "onnx" and (refusal := _policy_refusal(folder, launch)):
        return RobotPlan(robot=label, choice=None, refusal=refusal)
    answer = recall_choice(asked, launch.digest, folder / "robot.xml", controller, kind)
    return RobotPlan(robot=label, choice=answer.choice, refusal=answer.refusal)


def _policy_refusal(folder: Path, launch: ApplicationLaunch) -> str:
    """Returns why a policy cannot drive its robot; empty if it can."""
    from tasks.simulate.host.onnx_policy import control_range, require_onnxruntime  # noqa: PLC0415 - it imports MuJoCo

    try:
        require_onnxruntime()
        name = policy_file(launch.package, launch.launch_file)
        check_policy(folder, name, control_range(folder / "robot.xml").numbers)
    except RobotRefused as refused:
        return str(refused)
    return ""


def _lane_steps(plan: BatchPlan) -> int:
    settings = 1
    for values in plan.sweep.values():
        settings *= len(values)
    each = settings * len(plan.seeds) * PHYSICS_HZ
    return round(sum(len(plan.worlds_of(template)) * template.duration_s * each for template in plan.templates))


def _remembered_wall_s(plan: BatchPlan, programs: Sequence[_Program], episodes: int) -> Span | None:
    """Returns what whole batches of these programs took here; None if none has come to its end."""
    load_s = sum(ENGINES[each.engine].cost.load_s for each in programs)
    return remembered_wall_s(recall_batches(plan), plan, episodes, load_s) if programs else None


def _wall_s(programs: Sequence[_Program], episodes: int, lanes: int, longest_s: float, audited: int) -> Span:
    wall = _START_S.plus(_ROW_S.times(episodes))
    for program in programs:
        wall = wall.plus(program.wall_s(program.episodes, lanes, longest_s))
    if audited:  # as if they were all of the first program
        program, few = programs[0], min(audited, lanes)
        wall = wall.plus(program.wall_s(audited, few, longest_s, compiled=few == lanes))
        if program.engine != REFERENCE:
            wall = wall.plus(program.reference(few).wall_s(audited, few, longest_s))
    return wall


def _most(programs: Sequence[_Program], lanes: int, audited: int) -> Span:
    """Returns the most memory: programs follow one another in one process, which keeps what the largest took."""
    spans = [memory_bytes(each.engine, each.speed, lanes) for each in programs]
    if audited:
        reference = programs[0].reference(min(audited, lanes))
        spans.append(memory_bytes(reference.engine, reference.speed, min(audited, lanes)))
    low, high = max((span.low for span in spans), default=0.0), max((span.high for span in spans), default=0.0)
    return Span(low=low, high=high)
