"""Actions of ``launch`` that start nothing: arguments, groups, includes, the environment.

Behaviour as documented by ROS 2's packages launch and launch_ros.
"""

from __future__ import annotations

import runpy
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from tasks.ros.ros2.launch_file.substitutions import IfCondition, LaunchContext, NotDone, text_of, truth_of


class Entity:
    """What a launch description is made of."""

    def visit(self, context: LaunchContext) -> Iterable[Entity] | None:  # noqa: ARG002
        """Returns what is to be visited next."""
        return None


class LaunchDescription(Entity):
    """A list of entities."""

    def __init__(self, initial_entities: Iterable[Entity] | None = None) -> None:
        self.entities = list(initial_entities or ())

    def add_action(self, action: Entity) -> None:
        """Appends an action."""
        self.entities.append(action)

    def add_entity(self, entity: Entity) -> None:
        """Appends an entity."""
        self.entities.append(entity)

    def visit(self, context: LaunchContext) -> Iterable[Entity] | None:  # noqa: ARG002
        """Returns the entities."""
        return self.entities


class Action(Entity):
    """Something to do, if its condition holds."""

    def __init__(self, *, condition: IfCondition | None = None) -> None:
        self.condition = condition

    def visit(self, context: LaunchContext) -> Iterable[Entity] | None:
        """Returns what the action gives, if its condition holds."""
        if self.condition is None or self.condition.evaluate(context):
            return self.execute(context)
        return None

    def execute(self, context: LaunchContext) -> Iterable[Entity] | None:  # noqa: ARG002
        """Does it; returns what is to be visited next."""
        raise NotDone(f"{type(self).__name__} is not done: install ROS 2, or take it out of the launch file")


class DeclareLaunchArgument(Action):
    """Gives a launch configuration its default value."""

    def __init__(
        self,
        name: str,
        *,
        default_value: object = None,
        description: str = "",
        choices: list[str] | None = None,
        condition: IfCondition | None = None,
    ) -> None:
        super().__init__(condition=condition)
        self.name, self.default_value, self.description, self.choices = name, default_value, description, choices

    def execute(self, context: LaunchContext) -> None:
        """Sets the value, unless there is one."""
        values = context.launch_configurations
        if self.name not in values:
            if self.default_value is None:
                raise NotDone(f"the launch argument {self.name!r} has neither a value nor a default")
            values[self.name] = text_of(context, self.default_value)
        if self.choices is not None and values[self.name] not in self.choices:
            raise NotDone(f"the launch argument {self.name!r} is {values[self.name]!r}, not one of {self.choices}")


class SetLaunchConfiguration(Action):
    """Sets a launch configuration."""

    def __init__(self, name: object, value: object, *, condition: IfCondition | None = None) -> None:
        super().__init__(condition=condition)
        self._name, self._value = name, value

    def execute(self, context: LaunchContext) -> None:
        """Sets it."""
        context.launch_configurations[text_of(context, self._name)] = text_of(context, self._value)


class UnsetLaunchConfiguration(Action):
    """Takes a launch configuration away."""

    def __init__(self, name: object, *, condition: IfCondition | None = None) -> None:
        super().__init__(condition=condition)
        self._name = name

    def execute(self, context: LaunchContext) -> None:
        """Takes it away."""
        context.launch_configurations.pop(text_of(context, self._name), None)


class SetEnvironmentVariable(Action):
    """Sets an environment variable of the processes that follow."""

    def __init__(self, name: object, value: object, *, condition: IfCondition | None = None) -> None:
        super().__init__(condition=condition)
        self._name, self._value = name, value

    def execute(self, context: LaunchContext) -> None:
        """Sets it."""
        context.environment[text_of(context, self._name)] = text_of(context, self._value)


class AppendEnvironmentVariable(Action):
    """Adds to an environment variable."""

    def __init__(
        self,
        name: object,
        value: object,
        prepend: object = False,  # noqa: FBT002 - launch's own form
        *,
        separator: object = ":",
        condition: IfCondition | None = None,
    ) -> None:
        super().__init__(condition=condition)
        self._name, self._value, self._first, self._separator = name, value, prepend, separator

    def execute(self, context: LaunchContext) -> None:
        """Adds it."""
        name, value = text_of(context, self._name), text_of(context, self._value)
        first = self._first if isinstance(self._first, bool) else truth_of(text_of(context, self._first))
        parts = [value, context.environment[name]] if name in context.environment else [value]
        joint = text_of(context, self._separator)
        context.environment[name] = joint.join(parts if first else reversed(parts))


class UnsetEnvironmentVariable(Action):
    """Takes an environment variable away."""

    def __init__(self, name: object, *, condition: IfCondition | None = None) -> None:
        super().__init__(condition=condition)
        self._name = name

    def execute(self, context: LaunchContext) -> None:
        """Takes it away."""
        context.environment.pop(text_of(context, self._name), None)


class LogInfo(Action):
    """A line of the log, which nobody reads here."""

    def __init__(self, *, msg: object, condition: IfCondition | None = None) -> None:
        super().__init__(condition=condition)
        self.msg = msg

    def execute(self, context: LaunchContext) -> None:
        """Does nothing."""


class OpaqueFunction(Action):
    """A function of the launch file, which may give more entities."""

    def __init__(
        self,
        *,
        function: Callable[..., Iterable[Entity] | None],
        args: Iterable[object] = (),
        kwargs: Mapping[str, object] | None = None,
        condition: IfCondition | None = None,
    ) -> None:
        super().__init__(condition=condition)
        self._function, self._args, self._kwargs = function, list(args), dict(kwargs or {})

    def execute(self, context: LaunchContext) -> Iterable[Entity] | None:
        """Calls it."""
        return self._function(context, *self._args, **self._kwargs)


class _Step(Entity):
    def __init__(self, step: Callable[[LaunchContext], None]) -> None:
        self._step = step

    def visit(self, context: LaunchContext) -> None:
        """Does it."""
        self._step(context)


class GroupAction(Action):
    """Actions whose changes to configurations and environment end with them, if the group is scoped."""

    def __init__(
        self,
        actions: Iterable[Entity],
        *,
        scoped: bool = True,
        forwarding: bool = True,
        launch_configurations: Mapping[object, object] | None = None,
        condition: IfCondition | None = None,
    ) -> None:
        super().__init__(condition=condition)
        if not forwarding:
            raise NotDone("GroupAction with forwarding=False is not done: install ROS 2, or forward")
        self._actions, self._scoped = list(actions), scoped
        self._settings = [SetLaunchConfiguration(*each) for each in (launch_configurations or {}).items()]

    def execute(self, context: LaunchContext) -> Iterable[Entity]:  # noqa: ARG002
        """Returns the actions, in their scope."""
        inner = [*self._settings, *self._actions]
        return [_Step(LaunchContext.push), *inner, _Step(LaunchContext.pop)] if self._scoped else inner


class PythonLaunchDescriptionSource:
    """A launch file in Python."""

    def __init__(self, launch_file_path: object) -> None:
        self.place = launch_file_path


def described(path: str) -> LaunchDescription:
    """Returns what a launch file's ``generate_launch_description`` gives."""
    if not Path(path).is_file():
        raise NotDone(f"the launch file {path} is not there")
    if path.endswith(".xml"):
        from tasks.ros.ros2.launch_file.xml_launch import described_xml  # noqa: PLC0415 - made of what is here

        return described_xml(Path(path))
    if not path.endswith(".py"):
        raise NotDone(f"{path}: launch files in YAML are not done without ROS 2: install it, or write it in Python")
    names = runpy.run_path(path, run_name=Path(path).name.replace(".", "_"))
    if "generate_launch_description" not in names:
        raise NotDone(f"{path} has no function generate_launch_description")
    return names["generate_launch_description"]()


class IncludeLaunchDescription(Action):
    """Another launch file, with arguments; what it sets stays set."""

    def __init__(
        self,
        launch_description_source: object,
        *,
        launch_arguments: Iterable[tuple[object, object]] | None = None,
        condition: IfCondition | None = None,
    ) -> None:
        super().__init__(condition=condition)
        self._source, self._arguments = launch_description_source, list(launch_arguments or ())

    def execute(self, context: LaunchContext) -> Iterable[Entity]:
        """Returns the arguments and the launch file's description."""
        source = self._source
        path = text_of(context, source.place if isinstance(source, PythonLaunchDescriptionSource) else source)
        settings = [SetLaunchConfiguration(name, value) for name, value in self._arguments]
        inside = described(path)
        return [*settings, _Step(lambda own: own.enter(path)), inside, _Step(LaunchContext.leave)]


def visit_all(entity: Entity, context: LaunchContext) -> None:
    """Visits an entity and all that it gives, each before the next, as ``launch`` does."""
    for each in entity.visit(context) or ():
        visit_all(each, context)
