"""Actions that start processes: ExecuteProcess and Node; namespaces. Nothing is started: the context notes it.

Behaviour as documented by ROS 2's packages launch and launch_ros.
"""

import shlex
from collections.abc import Iterable, Mapping
from typing import Any

from tasks.ros.ros2.launch_file.stand_in.action import Action
from tasks.ros.ros2.launch_file.stand_in.condition import IfCondition
from tasks.ros.ros2.launch_file.stand_in.context import LaunchContext, NotDone, text_of
from tasks.ros.ros2.launch_file.stand_in.parameter import parameter_arguments

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
        command += parameter_arguments(context, full, self._parameters)
        pairs = [*context.launch_configurations.get("ros_remaps", ())]
        pairs += [(text_of(context, one), text_of(context, other)) for one, other in self._remappings]
        for one, other in pairs:
            command += ["-r", f"{one}:={other}"]
        shown = f"{below.rstrip('/')}/{name or executable}"
        self.note(context, command, environment, name=shown, package=package, kind=executable, ros=True)


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
    if executable not in found.programs:
        have = ", ".join(sorted(found.programs)) or "none"
        raise NotDone(
            f"the package {package} has no executable {executable!r}; it has {have}: build it, or name one of these"
        )
    paths = [*found.python, *filter(None, [context.environment.get("PYTHONPATH", "")])]
    return list(found.programs[executable]), {"PYTHONPATH": ":".join(paths)} if found.python else {}
