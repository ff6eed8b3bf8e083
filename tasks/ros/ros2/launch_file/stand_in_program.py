"""The program that evaluates a launch file with the stand-ins, in a process of its own: ``python -m`` this module.

It reads a request from standard input, as JSON: the launch file, the packages, the folder for parameter files; and
writes what the launch file starts, or why it does not, as the last line of standard output. It makes the modules that
launch files import of the stand-ins; what they lack is refused by name when used.
"""

import json
import os
import sys
import traceback
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from tasks.ros.ros2.launch_file import actions, node_actions, substitutions
from tasks.ros.ros2.launch_file import substitutions as contexts
from tasks.ros.ros2.launch_file.actions import described, visit_all
from tasks.ros.ros2.launch_file.substitutions import LaunchContext, NotDone, Package

_ACTIONS = (
    "DeclareLaunchArgument SetLaunchConfiguration UnsetLaunchConfiguration SetEnvironmentVariable GroupAction LogInfo "
    "AppendEnvironmentVariable UnsetEnvironmentVariable OpaqueFunction IncludeLaunchDescription"
)
_SUBSTITUTIONS = (
    "LaunchConfiguration EnvironmentVariable PathJoinSubstitution PythonExpression FindExecutable FileContent "
    "ThisLaunchFile ThisLaunchFileDir NotSubstitution AndSubstitution OrSubstitution AllSubstitution AnySubstitution "
    "Command EqualsSubstitution NotEqualsSubstitution IfElseSubstitution"
)
_CONDITIONS = "IfCondition UnlessCondition LaunchConfigurationEquals LaunchConfigurationNotEquals"
_PARAMETERS = "SetParameter SetUseSimTime SetParametersFromFile SetRemap"


def _named(module: ModuleType, names: str) -> dict[str, Any]:
    return {name: getattr(module, name) for name in names.split()}


def _modules(context: LaunchContext) -> Mapping[str, dict[str, Any]]:
    """Returns what each module has, by its name."""
    source = actions.PythonLaunchDescriptionSource
    pushed = node_actions.PushRosNamespace
    described = {f"{kind}LaunchDescriptionSource": source for kind in ("Python", "Any", "Frontend")}
    processes = {"ExecuteProcess": node_actions.ExecuteProcess, "Shutdown": node_actions.Shutdown}
    nodes = {"Node": node_actions.Node, "PushRosNamespace": pushed, "PushROSNamespace": pushed}
    text = {"TextSubstitution": contexts.TextSubstitution, "SubstitutionFailure": NotDone}
    root = {"LaunchDescription": actions.LaunchDescription, "LaunchContext": LaunchContext}
    entities = {
        "LaunchDescriptionEntity": actions.Entity,
        "Action": actions.Action,
        "Substitution": contexts.Substitution,
    }
    return {
        "launch": root | entities,
        "launch.action": {"Action": actions.Action},
        "launch.actions": _named(actions, _ACTIONS) | processes,
        "launch.conditions": _named(substitutions, _CONDITIONS),
        "launch.event_handlers": {},
        "launch.events": {},
        "launch.launch_context": {"LaunchContext": LaunchContext},
        "launch.launch_description": {"LaunchDescription": actions.LaunchDescription},
        "launch.launch_description_sources": described,
        "launch.substitution": {"Substitution": contexts.Substitution},
        "launch.substitutions": _named(substitutions, _SUBSTITUTIONS) | text,
        "launch_xml": {},
        "launch_xml.launch_description_sources": {"XMLLaunchDescriptionSource": source},
        "launch_ros": {},
        "launch_ros.actions": nodes | _named(node_actions, _PARAMETERS),
        "launch_ros.descriptions": _named(node_actions, "ParameterFile ParameterValue"),
        "launch_ros.parameter_descriptions": _named(node_actions, "ParameterFile ParameterValue"),
        "launch_ros.substitutions": _finders(context),
        "ament_index_python": _index(context),
        "ament_index_python.packages": _index(context),
    }


def _finders(context: LaunchContext) -> dict[str, Any]:
    """Returns the substitutions that find packages, with what launch files call while they are read."""

    class FindPackagePrefix(substitutions.FindPackagePrefix):
        def find(self, name: str) -> str:
            return context.package(name).prefix

    class FindPackageShare(substitutions.FindPackageShare):
        def find(self, name: str) -> str:
            return context.package(name).share

    return {"FindPackagePrefix": FindPackagePrefix, "FindPackageShare": FindPackageShare}


def _index(context: LaunchContext) -> dict[str, Any]:
    class PackageNotFoundError(KeyError):
        """No such package."""

    return {
        "PackageNotFoundError": PackageNotFoundError,
        "get_package_share_directory": lambda name: context.package(name).share,  # type: ignore[reportUnknownLambdaType]
        "get_package_share_path": lambda name: contexts.Path(context.package(name).share),  # type: ignore[reportUnknownLambdaType]
        "get_package_prefix": lambda name: context.package(name).prefix,  # type: ignore[reportUnknownLambdaType]
    }


def _refusing(module: str) -> Any:  # noqa: ANN401 - a module's __getattr__
    def absent(name: str) -> type:
        if name.startswith("__"):
            raise AttributeError(name)

        def refuse(_: object, *args: object, **kwargs: object) -> None:  # noqa: ARG001
            raise NotDone(f"{module}.{name} is not done: install ROS 2, or take it out of the launch file")

        return type(name, (), {"__init__": refuse})

    return absent


def install_modules(context: LaunchContext) -> None:
    """Makes ``import launch`` and its like find the stand-ins in this process."""
    for name, content in _modules(context).items():
        module = ModuleType(name, "A stand-in.")
        module.__dict__.update(content)
        module.__dict__.update({"__getattr__": _refusing(name), "__path__": []})
        sys.modules[name] = module
    for name in _modules(context):
        parent, _, own = name.rpartition(".")
        if parent:
            setattr(sys.modules[parent], own, sys.modules[name])


# What is raised where a stand-in has less than what it stands for.
_PERHAPS_OURS = (AttributeError, ImportError, TypeError)
# Names that Simyard sets for this program's own sake.
_OWN = ("PYTHONPATH", "PYTHONSAFEPATH")


def _processes(request: dict[str, Any]) -> list[dict[str, Any]]:
    """Returns what the launch file starts."""
    packages = {name: Package(**each) for name, each in request["packages"].items()}
    context = LaunchContext(packages, Path(request["folder"]))
    install_modules(context)
    context.enter(request["file"])
    visit_all(described(request["file"]), context)
    return context.processes


def _why(exc: BaseException, file: str) -> str:
    """Returns a fault of a launch file for a person: where in it, and what."""
    lines = [each.lineno for each in traceback.extract_tb(exc.__traceback__) if each.filename == file]
    place = f"line {lines[-1]}: " if lines else ""
    if isinstance(exc, NotDone):
        return f"{place}{exc}"
    if isinstance(exc, ModuleNotFoundError):
        return f"{place}it imports {exc.name}, which is not here: install ROS 2 and the packages that it needs"
    perhaps = "; if ROS 2's own launch takes it, install ROS 2" if isinstance(exc, _PERHAPS_OURS) else ""
    return f"{place}{type(exc).__name__}: {exc}{perhaps}"


def main() -> None:
    """Evaluates one launch file."""
    request = json.load(sys.stdin)
    for name in _OWN:
        os.environ.pop(name, None)
    if request["python_path"]:
        os.environ["PYTHONPATH"] = request["python_path"]
    try:
        answer: dict[str, Any] = {"processes": _processes(request)}
    except (Exception, SystemExit) as exc:  # noqa: BLE001 - whatever the launch file raises is its own
        answer = {"refused": " ".join(_why(exc, request["file"]).split())}
    sys.stdout.write(f"\n{json.dumps(answer)}\n")


if __name__ == "__main__":
    main()
