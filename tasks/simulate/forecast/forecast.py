"""The forecast of a batch: its engines, chunks, time and memory, in general found without importing JAX.

Time and memory are those of the last batch of these programs here. Where there was none they are unknown: all that is
said is a wide range, from what the engines took where they were measured.

The choice of a robot's engine is kept in the user's cache folder, because to make it anew imports MuJoCo. What is
remembered is good for the same bundle and the same code. Nothing of it is ever part of a result: a batch that runs
chooses anew. A folder that cannot be written to is as good as no memory at all.

What ROS nodes cost was measured with rospy nodes that answer each scan on two cores: 375 control steps a second with
one lane, 740 in all with 8, 620 with 32; 1.3, 2.3 and 6.5 s until they are ready; 32 to 42 MB a process. A node in C++
takes 2 MB.
"""

import hashlib
import logging
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from specs.base import Spec
from specs.data.episode import CONTROL_HZ, PHYSICS_HZ, ApplicationLaunch
from specs.field_types import EngineName
from specs.launched_file import policy_file
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.devices import DeviceKind, device_count, device_kind
from tasks.simulate.engines.engine_table import ENGINES, REFERENCE, EngineChoice, choose_engine
from tasks.simulate.forecast.batch_times import Span, compiling_s, recall_batches, remembered_bytes, remembered_wall_s
from tasks.simulate.forecast.camera_costs import CameraPlan, Driven, camera_plans
from tasks.simulate.host.declaration import ControllerKind, controller_kind
from tasks.simulate.host.policy_check import check_policy
from tasks.simulate.plan.batch_plan import BatchPlan, JobTemplate
from tasks.simulate.plan.episode_layout import Layout
from tasks.storage.base.local_files import cache_folder, whole_file

logger = logging.getLogger(__name__)
_CODE = Path(__file__).parents[1]
# Importing JAX and Prefect, the server's start, and for each episode its row in chunk and tables.
_START_S = Span(low=4.0, high=12.0)
_ROW_S = Span(low=0.2e-3, high=1e-3)
# Of what an engine took where it was measured: applications may be anything, and so may this machine.
_LEAST_GUESSED, _MOST_GUESSED = 0.25, 3.0
# Of a lane alone, and of each of many that share the cores.
_STEP_S, _LANE_STEP_S = 2.7e-3, 1.5e-3
_MEASURED_CORES = 2
_READY_S, _LANE_READY_S = 1.2, 0.17
_NODE_BYTES = 42_000_000
# Nodes that wait for single messages take 5 times as long; in C++ they take two thirds.
_LOW, _HIGH = 0.2, 1.5


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
        compile_s: How much longer it took at most where programs were compiled, as for worlds of another size.
        known: Whether both follow from the last batch of these programs here; else they are wide guesses.
        cameras: Of its robots, and what of the time is theirs.
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
    known: bool
    compile_s: float = 0.0
    cameras: tuple[CameraPlan, ...] = ()


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
    drives = [
        _Drive(choice.engine, episodes, plan.lanes, controllers[request.robot] in ("ros", "ros2"))
        for request, episodes in layout.programs()
        if (choice := choices[request.robot].choice)
    ]
    audited = min(plan.audit, layout.episodes) if drives else 0
    load_s = sum(ENGINES[each.engine].cost.load_s for each in drives)
    known = recall_batches(plan) if drives else []
    if audited:  # as if they were all of the first program
        engines = dict.fromkeys((drives[0].engine, REFERENCE))
        few = drives[0]._replace(episodes=audited, lanes=min(audited, plan.lanes))
        drives += [few._replace(engine=engine) for engine in engines]
    longest_s = max((template.duration_s for template in plan.templates), default=0.0)
    cameras = camera_plans(_driven(plan, folders, controllers), kind)
    guessed = _guessed_wall_s(drives, layout.episodes, longest_s)
    for camera in cameras:
        guessed = guessed.plus(camera.batch_s)
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
        wall_s=remembered_wall_s(known, plan, layout.episodes, load_s) or guessed,
        memory_bytes=remembered_bytes(known) or _guessed_bytes(drives),
        known=bool(known),
        compile_s=compiling_s(known, load_s),
        cameras=tuple(cameras),
    )


def _driven(
    plan: BatchPlan,
    folders: Mapping[str, Path],
    controllers: Mapping[ApplicationLaunch, ControllerKind],
) -> list[Driven]:
    """Returns a batch's robot applications, and for how long all episodes of each last at most."""
    simulated_s = dict.fromkeys(controllers, 0.0)
    for template in plan.templates:
        simulated_s[template.robot] += _simulated_s(plan, template)
    return [
        Driven(_label(launch, _robots(plan)), launch, folders[launch.digest], controller, simulated_s[launch])
        for launch, controller in controllers.items()
    ]


def _robots(plan: BatchPlan) -> list[ApplicationLaunch]:
    return list(dict.fromkeys(template.robot for template in plan.templates))


def _label(launch: ApplicationLaunch, launches: Sequence[ApplicationLaunch]) -> str:
    """Returns the name of a robot application, with what no other of that name in the batch has."""
    namesakes = [each for each in launches if each.name == launch.name]

    def parts(each: ApplicationLaunch) -> tuple[str, str, str, str]:
        architecture = each.architecture or "every architecture"
        return f"version {each.version}", architecture, f"{each.package}/{each.launched}", each.digest[:8]

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
    return round(PHYSICS_HZ * sum(_simulated_s(plan, template) for template in plan.templates))


def _simulated_s(plan: BatchPlan, template: JobTemplate) -> float:
    """Returns how long a request's episodes last together, if each takes its full duration."""
    settings = math.prod(map(len, plan.sweep.values()))
    turns = len(plan.seeds) * plan.sharing
    return settings * turns * len(plan.worlds_of(template)) * template.duration_s


class _Drive(NamedTuple):
    """Episodes that a program drives: those of the batch that are its own, or those of the audit.

    Attributes:
        nodes: Whether ROS nodes drive beside it.
    """

    engine: EngineName
    episodes: int
    lanes: int
    nodes: bool


def _guessed_wall_s(drives: Sequence[_Drive], episodes: int, longest_s: float) -> Span:
    """Returns a wide range for programs that have not run here."""
    steps = max(1, round(longest_s * CONTROL_HZ))
    wall = _START_S.plus(_ROW_S.times(episodes))
    for each in drives:
        cost, chunks = ENGINES[each.engine].cost, -(-each.episodes // each.lanes)
        drive_s = chunks * steps * (cost.step_s + each.lanes * cost.lane_step_s)
        measured_s = cost.compile_s + each.episodes * cost.ready_s + drive_s
        wall = wall.plus(Span(low=_LEAST_GUESSED * measured_s, high=_MOST_GUESSED * measured_s))
        if each.nodes:
            wall = wall.plus(nodes_s(each.episodes, each.lanes, steps))
    return wall


def _guessed_bytes(drives: Sequence[_Drive]) -> Span:
    """Returns the most memory: programs follow one another in one process, which keeps what the largest took."""
    costs = [(ENGINES[each.engine].cost, each.lanes) for each in drives]
    low = max((0.6 * (cost.base_bytes + lanes * cost.lane_bytes) for cost, lanes in costs), default=0.0)
    high = max((1.3 * cost.base_bytes + 3.0 * lanes * cost.lane_bytes for cost, lanes in costs), default=0.0)
    return Span(low=low, high=high)


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
