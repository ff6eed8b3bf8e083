"""The modules that launch files import, made of the stand-ins; what they lack is refused by name when used."""

import sys
from collections.abc import Mapping
from types import ModuleType
from typing import Any

from tasks.ros.ros2.launch_file.stand_in import action, condition, parameter, process_action, substitution
from tasks.ros.ros2.launch_file.stand_in import context as contexts
from tasks.ros.ros2.launch_file.stand_in.context import LaunchContext, NotDone

_ACTIONS = (
    "DeclareLaunchArgument SetLaunchConfiguration UnsetLaunchConfiguration SetEnvironmentVariable GroupAction LogInfo "
    "AppendEnvironmentVariable UnsetEnvironmentVariable OpaqueFunction IncludeLaunchDescription"
)
_SUBSTITUTIONS = (
    "LaunchConfiguration EnvironmentVariable PathJoinSubstitution PythonExpression FindExecutable FileContent "
    "ThisLaunchFile ThisLaunchFileDir NotSubstitution AndSubstitution OrSubstitution AllSubstitution AnySubstitution "
    "EqualsSubstitution NotEqualsSubstitution IfElseSubstitution"
)
_CONDITIONS = "IfCondition UnlessCondition LaunchConfigurationEquals LaunchConfigurationNotEquals"
_PARAMETERS = "SetParameter SetUseSimTime SetParametersFromFile SetRemap"


def _named(module: ModuleType, names: str) -> dict[str, Any]:
    return {name: getattr(module, name) for name in names.split()}


def _modules(context: LaunchContext) -> Mapping[str, dict[str, Any]]:
    """Returns what each module has, by its name."""
    source = action.PythonLaunchDescriptionSource
    pushed = process_action.PushRosNamespace
    described = {"PythonLaunchDescriptionSource": source, "AnyLaunchDescriptionSource": source}
    processes = {"ExecuteProcess": process_action.ExecuteProcess, "Shutdown": process_action.Shutdown}
    nodes = {"Node": process_action.Node, "PushRosNamespace": pushed, "PushROSNamespace": pushed}
    text = {"TextSubstitution": contexts.TextSubstitution, "SubstitutionFailure": NotDone}
    root = {"LaunchDescription": action.LaunchDescription, "LaunchContext": LaunchContext}
    entities = {
        "LaunchDescriptionEntity": action.Entity,
        "Action": action.Action,
        "Substitution": contexts.Substitution,
    }
    return {
        "launch": root | entities,
        "launch.action": {"Action": action.Action},
        "launch.actions": _named(action, _ACTIONS) | processes,
        "launch.conditions": _named(condition, _CONDITIONS),
        "launch.event_handlers": {},
        "launch.events": {},
        "launch.launch_context": {"LaunchContext": LaunchContext},
        "launch.launch_description": {"LaunchDescription": action.LaunchDescription},
        "launch.launch_description_sources": described,
        "launch.substitution": {"Substitution": contexts.Substitution},
        "launch.substitutions": _named(substitution, _SUBSTITUTIONS) | text,
        "launch_ros": {},
        "launch_ros.actions": nodes | _named(parameter, _PARAMETERS),
        "launch_ros.descriptions": _named(parameter, "ParameterFile ParameterValue"),
        "launch_ros.parameter_descriptions": _named(parameter, "ParameterFile ParameterValue"),
        "launch_ros.substitutions": _named(substitution, "FindPackageShare FindPackagePrefix"),
        "ament_index_python": _index(context),
        "ament_index_python.packages": _index(context),
    }


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
