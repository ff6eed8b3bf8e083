"""What kind of controller a robot application launches: read from its files, so that planning runs no code of it."""

import ast
from functools import lru_cache
from pathlib import Path
from typing import Literal

from specs.bundle.launched_file import (
    bundle_files,
    is_ros2,
    module_file,
    names_ros_launch,
    policy_file,
    ros_launch_file,
)
from specs.data.episode import ApplicationLaunch

ControllerKind = Literal["jax", "plain", "batched", "onnx", "ros", "ros2"]
_JAX = "jax"
_BATCHED = "controllers"
_MODULES_KNOWN = 64


def controller_kind(folder: Path, launch: ApplicationLaunch) -> ControllerKind:
    """Returns how a robot application is driven.

    Args:
        folder: Where the bundle is unpacked.
        launch: Its launch configuration.
    """
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
