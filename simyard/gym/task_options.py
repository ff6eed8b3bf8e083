"""What an environment is made of: worlds, a robot, a scenario, and what a trainer sees of them."""
# ruff: noqa: PLC0415 - what a task is made of is imported when one is made

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypedDict, cast

from specs.bundle_files import MOST_FRAMES

if TYPE_CHECKING:
    from simyard.answer.run_answers import Run, Worlds
    from specs.data.episode import ApplicationLaunch, EpisodeRequest
    from specs.data.world import World
    from tasks.simulate.training.training_program import Task, TrainingEngine, View
    from tasks.simulate.training.training_spaces import Reward

    WorldSource = str | os.PathLike[str] | Mapping[str, object] | Run | Worlds | Sequence[World]

Place = str | os.PathLike[str]
# A batch's seeds begin at 0: what is trained on and what is gated on are other episodes, unless one says otherwise.
FIRST_SEED = 1_000_000
_POOL = 256
_STARTER_WORLDS = 8
_DURATION_S = 60.0
_LAUNCHES = {
    "courier": "courier/go_to_goal",
    "wanderer": "wanderer/wander",
    "delivery": "delivery/rooms",
    "coverage": "coverage/floor",
}


class TaskOptions(TypedDict, total=False):
    """What an environment is made of; each may be left out.

    Attributes:
        worlds: As for ``simyard.worlds``: a generation job's name, a run, a template; or worlds themselves. Eight
            apartments of two rooms, if left out.
        store: As for ``simyard.worlds``.
        robot: A shipped robot's name, or the folder of a bundle with a ``robot.xml``; ``courier``.
        launch: ``<package>/<launch file>`` of the application in it that declares the robot's sensors.
        sensors: The sensors themselves, as ``{"lidar": {"rays": 32, ...}, "odometry": {...}, "bumper": {...},
            "depth_camera": {...}, "color_camera": {...}, "imu": {...}, "range_finders": {...}}``.
        scenario: A shipped scenario's name, or the folder of a bundle; ``delivery``.
        scenario_launch: ``<package>/<launch file>`` in it.
        environment: Environment variables of both, such as ``{"GOALS": "1"}``.
        seeds: The pool's seeds for each world: how many, counted from 1,000,000, or the seeds themselves. As many as
            give 256 episodes, if left out.
        duration_s: Simulated seconds after which an episode is truncated; 60.
        observation: Names of the fields that are seen, in their order; scan, pictures, goal and bumper, if left out.
        flatten: Whether they are one array, in that order, instead of a dictionary.
        frames: How many observations one after the other are seen together, as with ``FrameStackObservation`` of
            Gymnasium: the newest last, an episode's first repeated; one, without a dimension for it, if left out.
        actions: ``normalized`` (from -1 to 1 over each control range) or ``raw`` (controls).
        reward: A function in JAX of a ``Transition``; ``progress``, if left out.
        engine: ``planar``, ``mjx``, or ``auto`` for the first of them that can represent the robot.
    """

    worlds: "WorldSource | None"
    store: Place | None
    robot: Place
    launch: str | None
    sensors: Mapping[str, Mapping[str, object]] | None
    scenario: Place
    scenario_launch: str | None
    environment: Mapping[str, str]
    seeds: int | Sequence[int] | None
    duration_s: float
    observation: Sequence[str] | None
    flatten: bool
    frames: int | None
    actions: Literal["normalized", "raw"]
    reward: "Reward | None"
    engine: "TrainingEngine"


class _Application(NamedTuple):
    folder: Path
    launch: "ApplicationLaunch"


def task_of(options: TaskOptions) -> "Task":
    """Returns what is trained on.

    Raises:
        DocumentError: An option is wrong, or names what there is not.
        WorldRejected: A template gives no world.
    """
    from tasks.simulate.training.training_program import Task

    unknown = sorted(set(options) - set(TaskOptions.__annotations__))
    if unknown:
        raise _fault(unknown[0], dict(options)[unknown[0]], f"one of {', '.join(sorted(TaskOptions.__annotations__))}")
    worlds = _worlds(options)
    declared = options.get("sensors")
    robot = _application(options.get("robot", "courier"), options.get("launch"), "robot", bare=declared is not None)
    sensors = _sensors(declared, robot.folder)
    scenario = _application(options.get("scenario", "delivery"), options.get("scenario_launch"), "scenario")
    requests = _requests(options, [name for name, _ in worlds], robot.launch, scenario.launch)
    return Task(robot.folder, scenario.folder, requests, worlds, sensors)


def view_of(options: TaskOptions) -> "View":
    """Returns what a trainer sees, gives and is paid.

    Raises:
        DocumentError: An option is wrong.
    """
    from tasks.simulate.training.training_program import View
    from tasks.simulate.training.training_spaces import progress

    actions = options.get("actions", "normalized")
    if actions not in {"normalized", "raw"}:
        raise _fault("actions", actions, "normalized or raw")
    fields = options.get("observation")
    named = None if fields is None else tuple(fields)
    return View(named, normalized=actions == "normalized", reward=options.get("reward") or progress)


def frames_of(options: TaskOptions) -> int | None:
    """Returns how many observations are seen together; None for one that is no stack.

    Raises:
        DocumentError: It is no number of frames.
    """
    frames = options.get("frames")
    if frames is not None and (type(frames) is not int or not 1 <= frames <= MOST_FRAMES):
        raise _fault("frames", frames, f"a whole number from 1 to {MOST_FRAMES}")
    return frames


def _worlds(options: TaskOptions) -> "tuple[tuple[str, World], ...]":
    from simyard.answer.run_answers import Worlds
    from simyard.worlds_of import worlds
    from specs.data.world import World
    from tasks.worlds.starter_template import starter_template

    source = options.get("worlds")
    if isinstance(source, Sequence) and not isinstance(source, str | Worlds):
        given = list(source)
        if not given or not all(isinstance(each, World) for each in given):  # pyright: ignore[reportUnnecessaryIsInstance] - a caller may hand over anything
            raise _fault("worlds", "a list", "at least one world, such as `simyard.worlds(...)[0].document`")
        return tuple((f"{each.generation}/{each.name}", each) for each in given)
    if source is None:
        source = cast("Any", starter_template(["Living", "Bedroom"], "2"))
        found = worlds(source, count=_STARTER_WORLDS)
    else:
        found = source if isinstance(source, Worlds) else worlds(cast("Any", source), store=options.get("store"))
    return tuple((each.name, each.document) for each in found)


def _application(place: Place, launch: str | None, what: str, *, bare: bool = False) -> _Application:
    """Returns an application's folder, and how it is launched.

    Args:
        place: A shipped application's name, or a folder.
        launch: ``<package>/<launch file>``.
        what: For messages.
        bare: Whether nothing of it is launched.
    """
    from specs.data.episode import ApplicationLaunch
    from tasks.applications.registry import pack, shipped_application

    name = os.fspath(place)
    shipped = shipped_application(name)
    folder = Path(name).resolve() if shipped is None else shipped
    if not folder.is_dir():
        raise _fault(what, name, "the name of a shipped application, or a folder with a bundle")
    named = launch or (_LAUNCHES.get(name) if shipped else None) or ("-/-" if bare else "")
    package, _, file = named.partition("/")
    if not (package and file):
        option = "launch" if what == "robot" else "scenario_launch"
        raise _fault(
            option, named, f"<package>/<launch file> in {folder}" + (", or sensors" if what == "robot" else "")
        )
    digest = hashlib.sha256(pack(folder)).hexdigest()
    made = ApplicationLaunch(name=folder.name, version="1", digest=digest, package=package, launch_file=file)
    return _Application(folder, made)


def _requests(
    options: TaskOptions, worlds: Sequence[str], robot: "ApplicationLaunch", scenario: "ApplicationLaunch"
) -> "tuple[EpisodeRequest, ...]":
    """Returns the pool's episodes: each world with each seed, as a batch's matrix has them."""
    from specs.data.episode import EpisodeRequest

    seeds = options.get("seeds")
    if seeds is None:
        seeds = -(-_POOL // len(worlds))
    listed = tuple(range(FIRST_SEED, FIRST_SEED + seeds)) if isinstance(seeds, int) else tuple(seeds)
    duration_s = options.get("duration_s", _DURATION_S)
    if not listed or min(listed) < 0:
        raise _fault("seeds", seeds, "how many (1, 2, ...), or a list of seeds of at least 0")
    if not duration_s > 0.0:
        raise _fault("duration_s", duration_s, "more than 0")
    places = ((world, seed) for world in worlds for seed in listed)
    return tuple(
        EpisodeRequest(
            index=index,
            world=world,
            seed=int(seed),
            robot=robot,
            scenario=scenario,
            environment=dict(options.get("environment", {})),
            duration_s=duration_s,
        )
        for index, (world, seed) in enumerate(places)
    )


def _sensors(declared: Mapping[str, Mapping[str, object]] | None, folder: Path) -> object | None:
    from specs.bundle_files import SeeingDeclarations
    from tasks.documents.parse import parse
    from tasks.simulate.application.mjcf_check import RobotRefused
    from tasks.simulate.host.declaration import ROBOT_FILE, with_file_sensors

    if declared is None:
        return None
    known = SeeingDeclarations.model_fields
    if unknown := sorted(set(declared) - set(known)):
        raise _fault("sensors", unknown[0], f"some of {', '.join(known)}")
    try:
        forms = with_file_sensors(declared, folder / ROBOT_FILE)
    except RobotRefused as refused:
        raise _fault("sensors", "mjcf", str(refused)) from refused
    return parse(SeeingDeclarations, cast("Any", forms), "sensors")


def _fault(path: str, value: object, allowed: str) -> Exception:
    from specs.errors import DocumentError

    return DocumentError.of(path, repr(value), allowed, source="simyard.gym")
