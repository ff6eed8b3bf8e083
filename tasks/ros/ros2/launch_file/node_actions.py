"""Actions that start processes: ExecuteProcess and Node; namespaces, parameters, remappings.

Nothing is started: the context notes it. Behaviour as documented by ROS 2's packages launch and launch_ros.
"""

import hashlib
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import yaml

from tasks.ros.ros2.launch_file.actions import Action
from tasks.ros.ros2.launch_file.substitutions import IfCondition, LaunchContext, NotDone, Substitution, text_of

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
    try:
        value = yaml.safe_load(text or "''")
    except yaml.YAMLError:
        value = None  # such as a robot's description
    if isinstance(value, _SCALARS):
        return value
    items = cast("list[object]", value) if isinstance(value, list) else []
    if items and len({type(each) for each in items}) == 1 and isinstance(items[0], _SCALARS):
        return items
    raise NotDone(f"{text[:200]!r} is no value of a parameter: wrap text in ParameterValue(..., value_type=str)")


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


def parameter_arguments(context: LaunchContext, node: str, parameters: Iterable[object]) -> tuple[list[str], list[str]]:
    """Returns the arguments of parameters, those for all nodes first, so that its own win; and absent files."""
    arguments, absent = list[str](), list[str]()
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
        else:
            absent.append(path)
    return arguments, absent


def _inline(value: object) -> str:
    if isinstance(value, str):
        # As launch_ros has it: text that reads as a number becomes one.
        return value
    return yaml.safe_dump(value, default_flow_style=True).removesuffix("...\n").strip()


def _is_text(value: object) -> bool:
    return isinstance(value, Substitution | str | list | tuple)


# How output is shown and signals are waited for: nothing to a simulated episode.
_SHOWN = ("output", "output_format", "log_cmd", "emulate_tty", "cached_output", "exec_name", "description")
_WAITED = ("sigterm_timeout", "sigkill_timeout", "respawn_delay", "respawn_max_retries")
_IGNORED = frozenset({*_SHOWN, *_WAITED})


class Shutdown(Action):
    """The end of the application; done where a process's end asks for it."""


class ExecuteProcess(Action):
    """A process."""

    def __init__(
        self,
        *,
        cmd: Iterable[object],
        name: object = None,
        cwd: object = None,
        env: Mapping[object, object] | None = None,
        additional_env: Mapping[object, object] | None = None,
        prefix: object = None,
        shell: bool = False,
        respawn: bool = False,
        on_exit: object = None,
        condition: IfCondition | None = None,
        **others: object,
    ) -> None:
        super().__init__(condition=condition)
        unknown = sorted(set(others) - _IGNORED)
        if unknown:
            raise NotDone(f"{type(self).__name__}: {', '.join(unknown)} is not done: install ROS 2, or take it out")
        if not (on_exit is None or isinstance(on_exit, Shutdown)):
            raise NotDone(f"{type(self).__name__}: on_exit other than Shutdown() is not done: install ROS 2")
        self._cmd, self._name, self._cwd, self._shell = list(cmd), name, cwd, shell
        self._env, self._more, self._prefix = env, additional_env, prefix
        self._respawn, self._required = respawn, on_exit is not None

    def execute(self, context: LaunchContext) -> None:
        """Notes the process."""
        command = [text_of(context, each) for each in self._cmd]
        name = f"/{text_of(context, self._name) if self._name else command[0].rpartition('/')[2]}"
        self.note(context, command, {}, name=name, package="", kind=command[0], ros=False)

    def note(
        self,
        context: LaunchContext,
        command: list[str],
        environment: Mapping[str, str],
        **what: Any,  # noqa: ANN401 - values of JSON
    ) -> None:
        """Notes a process in the context."""
        before = shlex.split(text_of(context, self._prefix)) if self._prefix else []
        given = {**(self._env or {}), **(self._more or {})}
        own = {text_of(context, name): text_of(context, value) for name, value in given.items()}
        context.processes.append(
            {
                **what,
                "command": ["/bin/sh", "-c", " ".join([*before, *command])] if self._shell else [*before, *command],
                "environment": sorted({**context.changes(), **environment, **own}.items()),
                "cwd": text_of(context, self._cwd) if self._cwd else "",
                "required": self._required,
                "respawn": self._respawn,
            }
        )


class Node(ExecuteProcess):
    """A node of ROS 2: an executable of a package, with its name, namespace, parameters and remappings."""

    def __init__(
        self,
        *,
        executable: object = None,
        package: object = None,
        name: object = None,
        namespace: object = None,
        parameters: Iterable[object] | None = None,
        remappings: Iterable[tuple[object, object]] | None = None,
        arguments: Iterable[object] | None = None,
        ros_arguments: Iterable[object] | None = None,
        node_executable: object = None,
        node_name: object = None,
        node_namespace: object = None,
        **others: Any,  # noqa: ANN401 - those of ExecuteProcess
    ) -> None:
        # Foxy's names, which Galactic took away, mean the same.
        self._executable = node_executable if executable is None else executable
        self._node = node_name if name is None else name
        self._namespace = node_namespace if namespace is None else namespace
        if self._executable is None:
            raise NotDone("a Node has no executable")
        super().__init__(cmd=[], **others)
        self._package, self._parameters = package, list(parameters or ())
        self._remappings, self._arguments = list(remappings or ()), list(arguments or ())
        self._ros_arguments = list(ros_arguments or ())

    def execute(self, context: LaunchContext) -> None:
        """Notes the node."""
        executable = text_of(context, self._executable)
        package = "" if self._package is None else text_of(context, self._package)
        program, environment = _program(context, package, executable)
        name = "" if self._node is None else text_of(context, self._node)
        below = _namespace(context, self._namespace)
        command = [*program, *(text_of(context, each) for each in self._arguments), "--ros-args"]
        command += [text_of(context, each) for each in self._ros_arguments]
        command += ["-r", f"__node:={name}"] if name else []
        command += ["-r", f"__ns:={below}"] if below else []
        full = f"{below.rstrip('/')}/{name}" if name and below else "/**"
        given, absent = parameter_arguments(context, full, self._parameters)
        command += given
        pairs = [*context.launch_configurations.get("ros_remaps", ())]
        pairs += [(text_of(context, one), text_of(context, other)) for one, other in self._remappings]
        for one, other in pairs:
            command += ["-r", f"{one}:={other}"]
        shown = f"{below.rstrip('/')}/{name or executable}"
        what = {"name": shown, "package": package, "kind": executable, "ros": True, "absent": absent}
        self.note(context, command, environment, **what)


class PushRosNamespace(Action):
    """A namespace for the nodes that follow; ends with its group."""

    def __init__(self, namespace: object, *, condition: IfCondition | None = None) -> None:
        super().__init__(condition=condition)
        self._namespace = namespace

    def execute(self, context: LaunchContext) -> None:
        """Adds the namespace to those before."""
        context.launch_configurations["ros_namespace"] = _namespace(context, self._namespace)


def _namespace(context: LaunchContext, own: object) -> str:
    """Returns the namespace of a node below those that were pushed; empty for none."""
    before = str(context.launch_configurations.get("ros_namespace", ""))
    name = "" if own is None else text_of(context, own)
    joined = name if name.startswith("/") or not name else f"{before.rstrip('/')}/{name}"
    return joined or before


def _program(context: LaunchContext, package: str, executable: str) -> tuple[list[str], Mapping[str, str]]:
    if not package:
        return [executable], {}
    found = context.package(package)
    if not found.programs:
        raise NotDone(
            f"the package {package} has no executable {executable!r}, and none at all: build it with colcon, and bring "
            "the folder install in the bundle"
        )
    if executable not in found.programs:
        have = ", ".join(sorted(found.programs))
        raise NotDone(
            f"the package {package} has no executable {executable!r}; it has {have}: build it, or name one of these"
        )
    paths = [*found.python, *filter(None, [context.environment.get("PYTHONPATH", "")])]
    return list(found.programs[executable]), {"PYTHONPATH": ":".join(paths)} if found.python else {}
