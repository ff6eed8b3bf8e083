"""Parameters and remappings of nodes, as ``launch_ros`` evaluates them.

Behaviour as documented by ROS 2's package launch_ros.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import yaml

from tasks.ros.ros2.launch_file.stand_in.action import Action
from tasks.ros.ros2.launch_file.stand_in.condition import IfCondition
from tasks.ros.ros2.launch_file.stand_in.context import LaunchContext, NotDone, Substitution, text_of

_SCALARS = (bool, int, float, str)


class ParameterValue:
    """A parameter's value with its type; None takes the type from YAML."""

    def __init__(self, value: object, *, value_type: Any = None) -> None:  # noqa: ANN401 - a type, or a form of typing
        self._value, self._type = value, value_type

    def evaluate(self, context: LaunchContext) -> Any:  # noqa: ANN401 - what YAML has
        """Returns the value."""
        value = text_of(context, self._value) if _is_text(self._value) else self._value
        if self._type is None:
            return from_yaml(str(value))
        return self._type(from_yaml(str(value))) if self._type in (bool, int, float) else str(value)


class ParameterFile:
    """A file of parameters."""

    def __init__(self, param_file: object, *, allow_substs: object = False) -> None:
        if allow_substs is not False:
            raise NotDone("ParameterFile with allow_substs is not done: install ROS 2, or write the values out")
        self._path = param_file

    def evaluate(self, context: LaunchContext) -> str:
        """Returns the file's path."""
        return text_of(context, self._path)


class SetParameter(Action):
    """Sets a parameter of all nodes that follow."""

    def __init__(self, name: object, value: object, *, condition: IfCondition | None = None) -> None:
        super().__init__(condition=condition)
        self._name, self._value = name, value

    def execute(self, context: LaunchContext) -> None:
        """Sets it."""
        values = context.launch_configurations.setdefault("global_params", [])
        values.append((text_of(context, self._name), evaluated(context, self._value)))


class SetUseSimTime(SetParameter):
    """Sets use_sim_time of all nodes that follow; in a simulation it is true in the end."""

    def __init__(self, value: object, *, condition: IfCondition | None = None) -> None:
        super().__init__("use_sim_time", value, condition=condition)


class SetParametersFromFile(Action):
    """Gives a file of parameters to all nodes that follow."""

    def __init__(self, filename: object, *, condition: IfCondition | None = None) -> None:
        super().__init__(condition=condition)
        self._path = filename

    def execute(self, context: LaunchContext) -> None:
        """Gives it."""
        context.launch_configurations.setdefault("global_params", []).append(text_of(context, self._path))


class SetRemap(Action):
    """Renames a topic for all nodes that follow."""

    def __init__(self, src: object, dst: object, *, condition: IfCondition | None = None) -> None:
        super().__init__(condition=condition)
        self._pair = src, dst

    def execute(self, context: LaunchContext) -> None:
        """Renames it."""
        source, target = (text_of(context, each) for each in self._pair)
        context.launch_configurations.setdefault("ros_remaps", []).append((source, target))


def from_yaml(text: str) -> Any:  # noqa: ANN401 - what YAML has
    """Returns a value of a parameter from its text, as launch_ros reads it.

    Raises:
        NotDone: It is neither a value nor a list of values of one type.
    """
    value = yaml.safe_load(text or "''")
    if isinstance(value, _SCALARS):
        return value
    items = cast("list[object]", value) if isinstance(value, list) else []
    if items and len({type(each) for each in items}) == 1 and isinstance(items[0], _SCALARS):
        return items
    raise NotDone(f"{text!r} is no value of a parameter: wrap text in ParameterValue(..., value_type=str)")


def evaluated(context: LaunchContext, value: object) -> Any:  # noqa: ANN401 - what YAML has
    """Returns a parameter's value: substitutions are read as YAML, all else is itself."""
    if isinstance(value, ParameterValue):
        return value.evaluate(context)
    if isinstance(value, _SCALARS):
        return value
    if isinstance(value, Substitution):
        return from_yaml(text_of(context, value))
    items = list(cast("Iterable[object]", value)) if isinstance(value, Sequence) else []
    if items and all(isinstance(each, Substitution | str) for each in items):
        if any(isinstance(each, Substitution) for each in items):
            return from_yaml(text_of(context, items))
        return items
    if items and len({type(each) for each in items}) == 1:
        return [evaluated(context, each) for each in items]
    raise NotDone(f"{value!r} is no value of a parameter")


def flat(context: LaunchContext, values: Mapping[object, object], before: str = "") -> dict[str, Any]:
    """Returns parameters by their full names: a dictionary below a name is joined to it by a dot."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        name = before + text_of(context, key)
        if isinstance(value, Mapping):
            found.update(flat(context, cast("Mapping[object, object]", value), f"{name}."))
        else:
            found[name] = evaluated(context, value)
    return found


def parameter_file(context: LaunchContext, node: str, values: Mapping[str, Any]) -> str:
    """Returns the path of a file that holds parameters of a node; equal parameters have the same."""
    text = yaml.safe_dump({node: {"ros__parameters": dict(values)}}, default_flow_style=False)
    path = context.folder / f"launch_params_{hashlib.sha256(text.encode()).hexdigest()[:16]}.yaml"
    path.write_text(text)
    return str(path)


def parameter_arguments(context: LaunchContext, node: str, parameters: Iterable[object]) -> list[str]:
    """Returns the arguments of a node's parameters: those for all nodes first, so that its own win."""
    arguments: list[str] = []
    for each in context.launch_configurations.get("global_params", ()):
        arguments += ["--params-file", each] if isinstance(each, str) else ["-p", f"{each[0]}:={_inline(each[1])}"]
    for each in parameters:
        if isinstance(each, Mapping):
            path = parameter_file(context, node, flat(context, cast("Mapping[object, object]", each)))
        else:
            path = each.evaluate(context) if isinstance(each, ParameterFile) else text_of(context, each)
        # launch_ros warns of a file that is not there, and goes on without.
        if Path(path).is_file():
            arguments += ["--params-file", path]
    return arguments


def _inline(value: object) -> str:
    if isinstance(value, str):
        # As launch_ros has it: text that reads as a number becomes one.
        return value
    return yaml.safe_dump(value, default_flow_style=True).removesuffix("...\n").strip()


def _is_text(value: object) -> bool:
    return isinstance(value, Substitution | str | list | tuple)
