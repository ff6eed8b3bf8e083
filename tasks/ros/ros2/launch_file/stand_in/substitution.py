"""Substitutions of ``launch`` and ``launch_ros``.

Behaviour as documented by ROS 2's packages launch and launch_ros.
"""

import importlib
import math
import os
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path

import yaml

from tasks.ros.ros2.launch_file.stand_in.context import LaunchContext, NotDone, Substitution, text_of


class LaunchConfiguration(Substitution):
    """A launch configuration's value."""

    def __init__(self, variable_name: object, *, default: object = None) -> None:
        self._name, self._default = variable_name, default

    def perform(self, context: LaunchContext) -> str:
        """Returns the value, or the default."""
        name = text_of(context, self._name)
        if name in context.launch_configurations:
            return str(context.launch_configurations[name])
        if self._default is None:
            raise NotDone(f"the launch configuration {name!r} has no value: declare it with a default")
        return text_of(context, self._default)


class EnvironmentVariable(Substitution):
    """An environment variable's value."""

    def __init__(self, name: object, *, default_value: object = None) -> None:
        self._name, self._default = name, default_value

    def perform(self, context: LaunchContext) -> str:
        """Returns the value, or the default."""
        name = text_of(context, self._name)
        if name in context.environment:
            return context.environment[name]
        if self._default is None:
            raise NotDone(f"the environment variable {name!r} is not set: set it in the launch configuration")
        return text_of(context, self._default)


class PathJoinSubstitution(Substitution):
    """Parts of a path, joined."""

    def __init__(self, substitutions: Iterable[object]) -> None:
        self._parts = list(substitutions)

    def perform(self, context: LaunchContext) -> str:
        """Returns the path."""
        return os.path.join(*[text_of(context, each) for each in self._parts])  # noqa: PTH118 - text, as launch has it


class PythonExpression(Substitution):
    """What a Python expression gives, as text; runs where the launch file runs."""

    def __init__(self, expression: object, python_modules: Iterable[object] = ("math",)) -> None:
        self._expression, self._modules = expression, list(python_modules)

    def perform(self, context: LaunchContext) -> str:
        """Returns the text of the expression's value."""
        names: dict[str, object] = {}
        for name in (text_of(context, each) for each in self._modules):
            names[name] = importlib.import_module(name)
            if name == "math":
                names.update(vars(math))
        return str(eval(text_of(context, self._expression), {}, names))  # noqa: S307 - the launch file is code, too


class FindPackageShare(Substitution):
    """The folder ``share/<package>``."""

    def __init__(self, package: object) -> None:
        self._package = package

    def perform(self, context: LaunchContext) -> str:
        """Returns the folder."""
        return context.package(text_of(context, self._package)).share


class FindPackagePrefix(FindPackageShare):
    """The folder that a package is installed in."""

    def perform(self, context: LaunchContext) -> str:
        """Returns the folder."""
        return context.package(text_of(context, self._package)).prefix


class FindExecutable(Substitution):
    """A program that PATH finds."""

    def __init__(self, *, name: object) -> None:
        self._name = name

    def perform(self, context: LaunchContext) -> str:
        """Returns the program's path."""
        name = text_of(context, self._name)
        found = shutil.which(name, path=context.environment.get("PATH"))
        if found is None:
            raise NotDone(f"the program {name!r} is not there")
        return found


class FileContent(Substitution):
    """What a file holds."""

    def __init__(self, path: object) -> None:
        self._path = path

    def perform(self, context: LaunchContext) -> str:
        """Returns the file's text."""
        return Path(text_of(context, self._path)).read_text()


class ThisLaunchFile(Substitution):
    """The path of the launch file that is being evaluated."""

    def perform(self, context: LaunchContext) -> str:
        """Returns the path."""
        return context.places[-1]


class ThisLaunchFileDir(Substitution):
    """The folder of the launch file that is being evaluated."""

    def perform(self, context: LaunchContext) -> str:
        """Returns the folder."""
        return str(Path(context.places[-1]).parent)


class NotSubstitution(Substitution):
    """The contrary of a truth value."""

    def __init__(self, value: object) -> None:
        self._value = value

    def perform(self, context: LaunchContext) -> str:
        """Returns true or false."""
        return _word(not _truth(context, self._value))


class _Several(Substitution):
    judge: Callable[[Iterable[bool]], bool] = all

    def __init__(self, *values: object) -> None:
        self._values = values

    def perform(self, context: LaunchContext) -> str:
        """Returns true or false."""
        return _word(type(self).judge([_truth(context, each) for each in self._values]))


class AndSubstitution(_Several):
    """Whether two values are true."""


class AllSubstitution(_Several):
    """Whether all values are true."""


class OrSubstitution(_Several):
    """Whether one of two values is true."""

    judge = any


class AnySubstitution(_Several):
    """Whether one of several values is true."""

    judge = any


class EqualsSubstitution(Substitution):
    """Whether two texts, truth values or numbers are equal."""

    def __init__(self, left: object, right: object) -> None:
        self._left, self._right = left, right

    def perform(self, context: LaunchContext) -> str:
        """Returns true or false."""
        left, right = text_of(context, self._left), text_of(context, self._right)
        words = [each.strip().lower() for each in (left, right)]
        if all(each in {"true", "false"} for each in words):
            return _word(words[0] == words[1])
        try:
            return _word(math.isclose(float(left), float(right)))
        except ValueError:
            return _word(left == right)


class NotEqualsSubstitution(EqualsSubstitution):
    """Whether two texts, truth values or numbers differ."""

    def perform(self, context: LaunchContext) -> str:
        """Returns true or false."""
        return _word(super().perform(context) == "false")


class IfElseSubstitution(Substitution):
    """One of two texts."""

    def __init__(self, condition: object, if_value: object = "", else_value: object = "") -> None:
        self._condition, self._values = condition, (else_value, if_value)

    def perform(self, context: LaunchContext) -> str:
        """Returns the one that the condition chooses."""
        return text_of(context, self._values[_truth(context, self._condition)])


def _truth(context: LaunchContext, value: object) -> bool:
    found = yaml.safe_load(text_of(context, value))
    if not isinstance(found, bool):
        raise NotDone(f"{found!r} is not a truth value")
    return found


def _word(value: bool) -> str:  # noqa: FBT001
    return "true" if value else "false"
