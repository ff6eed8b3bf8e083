"""What a robot application's bundle declares, read from its files, so that planning runs no code of it.

Which kind of controller it launches, and how many lanes of that kind this machine holds at once. A YAML file is read
such that all that is wrong with it is said at once; nothing in it is run or followed, and a file of few bytes that
would take hours to read is refused.
"""

import ast
import os
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, TypeGuard, TypeVar, cast, get_args

import yaml
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from specs.base import Spec
from specs.bundle_files import Policy
from specs.data.episode import ApplicationLaunch, EpisodeRequest
from specs.launched_file import bundle_files, is_ros2, module_file, names_ros_launch, policy_file, ros_launch_file
from specs.ros_robot import ROS_FILE, RosRobot
from tasks.ros.ros2.dds_domain import DOMAINS
from tasks.simulate.application.bundle_code import load_factory
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.storage.image_files import read_image

ControllerKind = Literal["jax", "plain", "batched", "onnx", "ros", "ros2"]
_JAX = "jax"
_BATCHED = "controllers"
ROBOT_FILE = "robot.xml"
_MODULES_KNOWN = 64


def controller_kind(folder: Path, launch: ApplicationLaunch) -> ControllerKind:
    """Returns how a robot application is driven.

    Args:
        folder: Where the bundle is unpacked.
        launch: Its launch configuration.
    """
    if image := read_image(folder):
        return "ros2" if image.ros == 2 else "ros"
    if launch_path(folder, launch) is not None:
        return "ros2" if is_ros2(launch.launch_file) else "ros"
    module = module_path(folder, launch)
    if not module.is_file() and policy_path(folder, launch).is_file():
        return "onnx"
    return _python_kind(module)


def launch_path(folder: Path, launch: ApplicationLaunch) -> Path | None:
    """Returns the ROS launch file that a launch configuration names; None if it names none that the bundle has."""
    if not names_ros_launch(launch.launch_file):
        return None
    found = ros_launch_file(bundle_files(folder), launch.package, launch.launch_file)
    return None if found is None else folder / found


def module_path(folder: Path, launch: ApplicationLaunch) -> Path:
    """Returns where a bundle has the Python module that is launched."""
    return folder / module_file(launch.package, launch.launch_file)


def policy_path(folder: Path, launch: ApplicationLaunch) -> Path:
    """Returns where a bundle has the ONNX policy that is launched in place of a module."""
    return folder / policy_file(launch.package, launch.launch_file)


def _python_kind(module: Path) -> ControllerKind:
    """Returns ``plain`` or ``batched`` for a module that says ``jax = False``, else ``jax``."""
    try:
        found = module.stat()
    except OSError:
        return "jax"
    return _parsed_kind(module, (found.st_ino, found.st_size, found.st_mtime_ns))


@lru_cache(maxsize=_MODULES_KNOWN)
def _parsed_kind(module: Path, _state: tuple[int, ...]) -> ControllerKind:
    """Returns the kind of a module as it is now; each chunk of a batch asks for it, and parsing takes its time."""
    try:
        statements = ast.parse(module.read_bytes()).body
    except (OSError, SyntaxError, ValueError):
        return "jax"  # what is wrong with it is told when it is imported
    if not any(map(_says_no_jax, statements)):
        return "jax"
    defined = {each.name for each in statements if isinstance(each, ast.FunctionDef)}
    return "batched" if _BATCHED in defined else "plain"


def _says_no_jax(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.Assign)
        and [target.id for target in statement.targets if isinstance(target, ast.Name)] == [_JAX]
        and isinstance(statement.value, ast.Constant)
        and statement.value.value is False
    )


# A program's lanes are whole vectors of eight: fewer at once save nothing but memory.
FEWEST_LANES = 8
_WITH_PROCESSES: frozenset[ControllerKind] = frozenset({"ros", "ros2"})
# Of an application of three or four nodes; one in Python takes 30 to 40 MB by itself.
_LANE_BYTES = 128 << 20
# More at once are not done sooner, and come to rest later after each stage of a control step.
_LANES_A_CORE = 16
# Each lane of ROS 2 has a DDS domain of its own; whole vectors of them.
_DOMAIN_LANES = len(DOMAINS) // FEWEST_LANES * FEWEST_LANES
# The rest is for what simulates, and for whoever else works here.
_SHARE = 0.6


def most_lanes(requests: Sequence[EpisodeRequest], bundles: Mapping[str, Path]) -> int | None:
    """Returns how many of some episodes this machine simulates at once; None where only arrays count.

    No result depends on it: a lane has the same row whichever lanes run beside it.

    Args:
        requests: The episodes.
        bundles: Unpacked folders of their applications, by digest.
    """
    robots = [request.robot for request in requests if request.robot.digest in bundles]
    launches = {(robot.digest, robot.package, robot.launch_file): robot for robot in robots}
    kinds = {controller_kind(bundles[robot.digest], robot) for robot in launches.values()}
    if not kinds & _WITH_PROCESSES:
        return None
    by_memory, by_cores = int(_SHARE * available_bytes() / _LANE_BYTES), _LANES_A_CORE * len(os.sched_getaffinity(0))
    return max(FEWEST_LANES, min(by_memory, by_cores, _DOMAIN_LANES if "ros2" in kinds else by_cores))


def available_bytes(root: Path = Path("/")) -> int:
    """Returns the memory that is free for new processes, of the machine and of the container that this one runs in.

    Args:
        root: Of the files that tell.
    """
    machine = _fields(root / "proc/meminfo").get("MemAvailable", 0) << 10
    limit, used = (_number(root / "sys/fs/cgroup" / name) for name in ("memory.max", "memory.current"))
    return max(0, machine if limit is None or used is None else min(machine, limit - used))


def _fields(path: Path) -> dict[str, int]:
    try:
        lines = path.read_text().splitlines()
    except OSError:
        return {}
    pairs = (line.split() for line in lines)
    return {pair[0].rstrip(":"): int(pair[1]) for pair in pairs if len(pair) > 1 and pair[1].isdecimal()}


def _number(path: Path) -> int | None:
    try:
        text = path.read_text().strip()
    except OSError:
        return None
    return int(text) if text.isdecimal() else None


_MOST_BYTES = 64 << 10
_MOST_LEVELS = 16
_SHOWN = 80
# What PyYAML raises of a value that is not what its tag or its form says.
_NO_VALUE = (ValueError, OverflowError, LookupError, AttributeError, TypeError)
S = TypeVar("S", bound=Spec)


def read_declaration(path: Path, name: str, form: type[S], robot: Path) -> S | None:
    """Returns what a file declares; None if there is no such file.

    Args:
        path: The file.
        name: Of it, as its author knows it.
        form: What it may say.
        robot: The ``robot.xml``, whose sensors it may ask for.

    Raises:
        RobotRefused: The file is no YAML, or says what it must not.
    """
    try:
        with path.open("rb") as file:
            text = file.read(_MOST_BYTES + 1)
    except FileNotFoundError:
        return None
    except OSError as exc:
        raise RobotRefused(f"{name}: cannot be read: {exc.strerror}") from exc
    if len(text) > _MOST_BYTES:
        raise RobotRefused(f"{name}: more than {_MOST_BYTES} bytes: a declaration is a page")
    loaded = _loaded(text, name)
    try:
        return form.model_validate(
            with_file_sensors(cast("dict[str, Any]", loaded), robot) if isinstance(loaded, dict) else loaded
        )
    except RobotRefused as refused:
        raise RobotRefused(f"{name}: {refused}") from refused
    except ValidationError as exc:
        faults = (
            f"{'.'.join(map(str, each['loc']))}: {_short(each['input'])}: {_words(each, form)}" for each in exc.errors()
        )
        raise RobotRefused("; ".join(f"{name}: {fault.removeprefix(': ')}" for fault in faults)) from exc


def _words(error: ErrorDetails, form: type[BaseModel]) -> str:
    """Returns what is wrong with a value; for a key that nobody knows, the keys that may stand there."""
    if error["type"] != "extra_forbidden":
        return error["msg"]
    forms = [form]
    for step in error["loc"][:-1]:  # the index of a list, and the kind of a drive, lead to the same forms
        inner = [found for one in forms if (field := one.model_fields.get(str(step))) for found in _forms(field)]
        forms = inner or forms
    return f"an unknown key; known are {', '.join(dict.fromkeys(key for one in forms for key in one.model_fields))}"


def _forms(field: FieldInfo) -> list[type[BaseModel]]:
    """Returns the mappings that a field may hold, in lists and choices, too."""
    open_types: list[Any] = [field.annotation]
    found: list[type[BaseModel]] = []
    while open_types:
        each = open_types.pop()
        if isinstance(each, type) and issubclass(each, BaseModel):
            found.append(each)
        open_types += get_args(each)
    return found


def _loaded(text: bytes, name: str) -> object:
    """Returns the file's mapping.

    Raises:
        RobotRefused: It is no YAML, or so deep, or with parts that stand for others, that few bytes would take hours.
    """
    try:
        _require_plain(text, name)
        found = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, *_NO_VALUE) as exc:
        raise RobotRefused(f"{name}: no YAML: {' '.join(str(exc).split())[:300]}") from exc
    return {} if found is None else found


def _require_plain(text: bytes, name: str) -> None:
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        if isinstance(event, yaml.AliasEvent):
            raise RobotRefused(f"{name}: an alias (*name): write out what it stands for")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _MOST_LEVELS:
            raise RobotRefused(f"{name}: more than {_MOST_LEVELS} levels: a declaration has three")


def _short(value: object) -> str:
    shown = repr(value)
    return shown if len(shown) <= _SHOWN else f"{shown[:_SHOWN]}..."


def read_ros_robot(folder: Path) -> RosRobot:
    """Returns what a bundle declares of its ROS robot; the defaults of one that declares nothing.

    Args:
        folder: Where the bundle is unpacked.

    Raises:
        RobotRefused: The file is no YAML, or says what it must not.
    """
    return read_declaration(folder / ROS_FILE, ROS_FILE, RosRobot, folder / ROBOT_FILE) or RosRobot()


_OF_FILE = "mjcf"
_FILE_KINDS = {"depth_camera": "camera", "color_camera": "camera", "imu": "imu", "range_finders": "rangefinder"}


def with_file_sensors(declared: Mapping[str, Any], robot: Path) -> dict[str, Any]:
    """Returns declarations with those sensors of a robot's MJCF that they ask for; what they say themselves stays.

    Args:
        declared: By name; ``mjcf`` in one of them names what of the file it is.
        robot: The ``robot.xml``.

    Raises:
        RobotRefused: The file has no such sensor, or cannot be read.
    """
    return {name: _taken(name, own, robot) if name in _FILE_KINDS else own for name, own in declared.items()}


def _taken(name: str, own: object, robot: Path) -> object:
    """Returns a declaration, or each of a list, with what it asks for of the file."""
    if isinstance(own, list | tuple):
        return [_taken(name, each, robot) for each in cast("Sequence[object]", own)]
    if not isinstance(own, Mapping) or _OF_FILE not in own:
        return own
    return _with_file_sensor(name, dict(cast("Mapping[str, Any]", own)), robot)


def _with_file_sensor(name: str, own: dict[str, Any], robot: Path) -> dict[str, Any]:
    found, asked = _file_sensors(robot)[_FILE_KINDS[name]], own.pop(_OF_FILE)
    names = [asked] if isinstance(asked, str) or not isinstance(asked, Sequence) else [*asked]
    if missing := [each for each in names if each not in found] or ([asked] if not names else []):
        allowed = f"must be one of {', '.join(found)}" if found else "it has none that can be taken"
        raise RobotRefused(f"{name}.{_OF_FILE}: {missing[0]!r}: no {_FILE_KINDS[name]} of robot.xml: {allowed}")
    if len(names) == 1:
        return {**found[names[0]], **own}
    from tasks.simulate.application.robot_sensors import finders_together  # noqa: PLC0415 - it imports MuJoCo

    together = finders_together([found[each] for each in names]) if name == "range_finders" else None
    if together is None:
        allowed = "one name; of range finders several that are alike and equally far apart, counter-clockwise"
        raise RobotRefused(f"{name}.{_OF_FILE}: {', '.join(names)}: must be {allowed}")
    return {**together, **own}


@lru_cache(maxsize=_MODULES_KNOWN)
def _file_sensors(robot: Path) -> Mapping[str, Mapping[str, Mapping[str, float]]]:
    from tasks.simulate.application.robot_file import read_file_sensors  # noqa: PLC0415 - it imports MuJoCo

    return read_file_sensors(robot).found


def load_controller(
    folder: Path, launch: ApplicationLaunch, factory: Literal["controller", "controllers"]
) -> Callable[..., object]:
    """Returns the function of that name in a bundle's module, which declares what the robot's file has as that is.

    Args:
        folder: Where the bundle is unpacked.
        launch: The package and the launch file.
        factory: Name of the function.

    Raises:
        BundleCrash: The module does not import, or has no such function.
    """
    make = load_factory(folder, launch, factory, "RobotApplicationCrash")

    def made(environment: object) -> object:
        controller = make(environment)
        asking = {name: each for name in _FILE_KINDS if _asks(each := getattr(controller, name, None))}
        return _Declaring(controller, asking, folder / ROBOT_FILE) if asking else controller

    return made


class _Declaring:
    """A controller whose sensors are those of the robot's file where it asks for them."""

    def __init__(self, controller: object, asking: Mapping[str, object], robot: Path) -> None:
        self._controller = controller
        own = {
            name: [_written(one, name) for one in each] if _is_list(each) else _written(each, name)
            for name, each in asking.items()
        }
        for name, found in with_file_sensors(own, robot).items():
            every = [SimpleNamespace(**each) for each in (found if isinstance(found, list) else [found])]
            setattr(self, name, every if isinstance(found, list) else every[0])

    def __getattr__(self, name: str) -> object:
        return getattr(self._controller, name)


def _is_list(declared: object) -> TypeGuard[Sequence[object]]:
    return isinstance(declared, list | tuple) and not hasattr(declared, "_fields")


def _asks(declared: object) -> bool:
    """Returns whether a sensor, or one of a list, asks for what the robot's file has."""
    return any(hasattr(each, _OF_FILE) for each in (declared if _is_list(declared) else [declared]))


def _written(declared: object, name: str) -> dict[str, object]:
    return {field: getattr(declared, field) for field in sorted(_fields_of(name)) if hasattr(declared, field)}


def _fields_of(name: str) -> set[str]:
    forms = Policy.model_fields[name].annotation
    return {_OF_FILE, *(field for form in get_args(forms) for field in getattr(form, "model_fields", ()))}
