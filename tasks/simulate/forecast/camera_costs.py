"""What cameras cost a batch: pictures a second of a core, and their part of its time, before anything has run.

Each figure is a range, from the fastest row of the tables in docs/guide/cameras.md to the slowest. A policy's or a ROS
robot's cameras stand in its YAML file. No code is run: a module's are read where it writes their numbers down.
"""

import ast
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import ValidationError

from specs.base import Spec
from specs.bundle_files import CameraDeclaration, ColorCameraDeclaration, DepthCameraDeclaration, Policy
from specs.data.episode import CONTROL_HZ, ApplicationLaunch, control_stride
from specs.launched_file import policy_file
from specs.ros_robot import RosRobot
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.devices import DeviceKind, device_count
from tasks.simulate.forecast.batch_times import Span
from tasks.simulate.host.declaration import (
    ROBOT_FILE,
    ControllerKind,
    module_path,
    read_declaration,
    read_ros_robot,
    with_file_sensors,
)

CameraKind = Literal["depth_camera", "color_camera"]
_FORMS: Mapping[CameraKind, type[CameraDeclaration]] = {
    "depth_camera": DepthCameraDeclaration,
    "color_camera": ColorCameraDeclaration,
}


class _Cost(NamedTuple):
    """Seconds of a core: of each picture, and of each pixel more."""

    picture_s: float
    pixel_s: float


# Lines through the fastest and the slowest rows of what benchmarks.simulation.cameras measured.
_COSTS: Mapping[CameraKind, tuple[_Cost, _Cost]] = {
    "depth_camera": (_Cost(75e-6, 18e-9), _Cost(330e-6, 43e-9)),
    "color_camera": (_Cost(220e-6, 27e-9), _Cost(880e-6, 36e-9)),
}


class CameraPlan(Spec):
    """A robot's camera in a batch.

    Attributes:
        robot: The application's name, as that of its ``RobotPlan``.
        kind: As it is declared.
        cameras: How many, of a list; each takes pictures.
        columns, rows: Of its pictures.
        rate_hz: At which they are taken.
        assumed: Whether only the robot's code knows these numbers, and they are the usual ones.
        pictures: Of a core in a second.
        batch_s: The wall time that all pictures take, if every episode takes its full duration.
    """

    robot: str
    kind: CameraKind
    cameras: int
    columns: int
    rows: int
    rate_hz: float
    assumed: bool
    pictures: Span
    batch_s: Span


class Driven(NamedTuple):
    """What is simulated of a robot application.

    Attributes:
        label: Its name in the plan.
        folder: Of its bundle.
        simulated_s: Of all its episodes together.
    """

    label: str
    launch: ApplicationLaunch
    folder: Path
    controller: ControllerKind
    simulated_s: float


def camera_plans(robots: Sequence[Driven], device: DeviceKind) -> list[CameraPlan]:
    """Returns the cameras of a batch's robots.

    Args:
        robots: The robot applications.
        device: What JAX will run on; depth cameras on a GPU were not measured, and are left out.
    """
    return [
        _plan(robot, kind, found)
        for robot in robots
        for kind, found in _cameras(robot).items()
        if device == "cpu" or kind == "color_camera"
    ]


def _plan(robot: Driven, kind: CameraKind, found: CameraDeclaration | None) -> CameraPlan:
    camera = found or _FORMS[kind]()
    rate_hz, pixels = CONTROL_HZ / control_stride(camera.rate_hz), camera.columns * camera.rows
    fast_s, slow_s = (cost.picture_s + pixels * cost.pixel_s for cost in _COSTS[kind])
    cores = device_count() if kind == "depth_camera" else len(os.sched_getaffinity(0))
    taken = robot.simulated_s * rate_hz * len(camera.every) / cores
    return CameraPlan(
        robot=robot.label,
        kind=kind,
        cameras=len(camera.every),
        columns=camera.columns,
        rows=camera.rows,
        rate_hz=rate_hz,
        assumed=found is None,
        pictures=Span(low=1.0 / slow_s, high=1.0 / fast_s),
        batch_s=Span(low=taken * fast_s, high=taken * slow_s),
    )


def _cameras(robot: Driven) -> dict[CameraKind, CameraDeclaration | None]:
    """Returns a robot's cameras; None for one whose numbers only its code knows."""
    if robot.controller in ("jax", "plain", "batched"):
        return dict(_of_module(module_path(robot.folder, robot.launch), robot.folder / ROBOT_FILE))
    try:
        declared = _declared(robot)
    except RobotRefused:  # which the plan of its engine says
        return {}
    return {kind: found for kind in _FORMS if (found := getattr(declared, kind, None)) is not None}


def _declared(robot: Driven) -> Policy | RosRobot | None:
    if robot.controller != "onnx":
        return read_ros_robot(robot.folder)
    name = f"{policy_file(robot.launch.package, robot.launch.launch_file).removesuffix('.onnx')}.yaml"
    return read_declaration(robot.folder / name, name, Policy, robot.folder / ROBOT_FILE)


def _of_module(module: Path, robot: Path) -> Iterator[tuple[CameraKind, CameraDeclaration | None]]:
    try:
        tree = ast.parse(module.read_bytes())
    except (OSError, SyntaxError, ValueError):
        return  # what is wrong with it is told when it is imported
    classes = {each.name: each for each in ast.walk(tree) if isinstance(each, ast.ClassDef)}
    for kind in _FORMS:
        for value in _assigned(tree, kind):
            yield kind, _written_down(kind, value, classes, robot)
            break


def _assigned(tree: ast.AST, name: str) -> Iterator[ast.expr]:
    """Yields what is assigned to a name, or to an attribute of that name, in a module; but for None."""
    for each in ast.walk(tree):
        single = [each.target] if isinstance(each, ast.AnnAssign) else []
        targets = each.targets if isinstance(each, ast.Assign) else single
        names = {getattr(target, "id", None) or getattr(target, "attr", None) for target in targets}
        value = getattr(each, "value", None)
        if name in names and value is not None and not (isinstance(value, ast.Constant) and value.value is None):
            yield value


def _written_down(
    kind: CameraKind, value: ast.expr, classes: Mapping[str, ast.ClassDef], robot: Path
) -> CameraDeclaration | None:
    """Returns a camera that is made of a class of the module, from numbers alone, or a list of such; else None."""
    several = value.elts if isinstance(value, ast.List | ast.Tuple) else None
    written = [_written(kind, each, classes, robot) for each in several or [value]]
    if None in written:
        return None
    try:
        return _FORMS[kind].model_validate(written if several else written[0])
    except ValidationError:  # which a run will say
        return None


def _written(
    kind: CameraKind, value: ast.expr, classes: Mapping[str, ast.ClassDef], robot: Path
) -> dict[str, Any] | None:
    if not isinstance(value, ast.Call) or not isinstance(value.func, ast.Name) or value.args:
        return None
    if value.func.id not in classes and not value.keywords:
        return None
    try:
        fields = dict(_fields(classes.get(value.func.id)))
        fields |= {each.arg: ast.literal_eval(each.value) for each in value.keywords if each.arg}
        known = {"mjcf", *_FORMS[kind].model_fields}
        own = {name: each for name, each in fields.items() if name in known}
        declared = with_file_sensors({kind: own}, robot)[kind]
    except (ValueError, TypeError, RobotRefused):  # what it is only its code knows, or a run will say
        return None
    return declared if "columns" in declared or kind == "color_camera" else None


def _fields(made: ast.ClassDef | None) -> Iterator[tuple[str, Any]]:
    for each in made.body if made else ():
        if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name) and each.value is not None:
            yield each.target.id, ast.literal_eval(each.value)
        elif isinstance(each, ast.Assign) and isinstance(each.targets[0], ast.Name):
            yield each.targets[0].id, ast.literal_eval(each.value)
        elif isinstance(each, ast.Assign) and isinstance(each.targets[0], ast.Tuple):
            names = [name.id for name in each.targets[0].elts if isinstance(name, ast.Name)]
            yield from zip(names, ast.literal_eval(each.value), strict=True)
