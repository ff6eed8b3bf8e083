"""What a launch file is evaluated in, and the substitutions and conditions of ``launch`` and ``launch_ros``.

Behaviour as documented by ROS 2's packages launch and launch_ros.
"""

import importlib
import math
import os
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml


class NotDone(Exception):  # noqa: N818 - a state
    """The launch file needs what is not done without ROS 2, or is wrong; says what."""


class Package(NamedTuple):
    """A package of the bundle or of ROS 2.

    Attributes:
        share: Its folder of launch files, parameters and models.
        prefix: Where it is installed; its own folder if it is a source package.
        programs: Commands by an executable's name.
        python: Folders that its Python modules lie in.
    """

    share: str
    prefix: str
    programs: Mapping[str, list[str]]
    python: list[str]


class LaunchContext:
    """State of the evaluation.

    Attributes:
        launch_configurations: Values by name, as ``launch`` has them.
        environment: Variables, as changed so far.
        packages: By name.
        folder: Where parameter files are written to.
        processes: What was started so far.
        places: The launch files that are being evaluated, the innermost last.
    """

    def __init__(self, packages: Mapping[str, Package], folder: Path) -> None:
        self.launch_configurations: dict[str, Any] = {}
        self.environment: dict[str, str] = dict(os.environ)
        self.before = dict(self.environment)
        self.packages, self.folder = packages, folder
        self.processes: list[dict[str, Any]] = []
        self.places: list[str] = []
        self._kept: list[tuple[dict[str, Any], dict[str, str]]] = []

    def push(self) -> None:
        """Keeps configurations and environment, to be restored by ``pop``."""
        kept = {
            name: list(each) if isinstance(each, list) else each for name, each in self.launch_configurations.items()
        }
        self._kept.append((kept, dict(self.environment)))

    def pop(self) -> None:
        """Restores what the last ``push`` kept."""
        self.launch_configurations, self.environment = self._kept.pop()

    def enter(self, path: str) -> None:
        """Begins a launch file."""
        self.places.append(path)

    def leave(self) -> None:
        """Ends the innermost launch file."""
        self.places.pop()

    def changes(self) -> dict[str, str]:
        """Returns the environment variables that the launch file has set; those that it took away are empty."""
        gone = {name: "" for name in self.before if name not in self.environment}
        return gone | {name: value for name, value in self.environment.items() if self.before.get(name) != value}

    def package(self, name: str) -> Package:
        """Returns a package.

        Raises:
            NotDone: Neither the bundle nor ROS 2 has it.
        """
        if name not in self.packages:
            from specs.rules import meant  # noqa: PLC0415 - it imports pydantic, and few have to wait for that

            remedy = meant(name, self.packages) or "bring it in the bundle, or install ROS 2's"
            raise NotDone(f"there is no package {name!r} in the bundle or in ROS 2: {remedy.strip()}")
        return self.packages[name]

    def perform_substitution(self, substitution: "Substitution") -> str:
        """Returns a substitution's text, as ``launch`` names it."""
        return substitution.perform(self)


class Substitution:
    """Text that is known once a launch file is evaluated."""

    def perform(self, context: LaunchContext) -> str:  # noqa: ARG002
        """Returns the text."""
        raise NotDone(f"{type(self).__name__} has no text")


class TextSubstitution(Substitution):
    """Text that is known before."""

    def __init__(self, *, text: str) -> None:
        self.text = text

    def perform(self, context: LaunchContext) -> str:  # noqa: ARG002
        """Returns the text."""
        return self.text


def substitutions(value: object) -> list[Substitution]:
    """Returns a value of a launch file as substitutions: text, a path, a substitution, or several of them."""
    if isinstance(value, Substitution):
        return [value]
    if isinstance(value, str | Path):
        return [TextSubstitution(text=str(value))]
    if isinstance(value, Iterable):
        return [one for each in value for one in substitutions(each)]
    raise NotDone(f"{value!r} is neither text nor a substitution")


def text_of(context: LaunchContext, value: object) -> str:
    """Returns the text of a value of a launch file."""
    return "".join(each.perform(context) for each in substitutions(value))


def truth_of(text: str) -> bool:
    """Returns a condition's value, as ``launch`` reads it: true, 1, false or 0."""
    if text.strip().lower() in {"true", "1"}:
        return True
    if text.strip().lower() in {"false", "0"}:
        return False
    raise NotDone(f"{text!r} is no condition: true, 1, false and 0 are")


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


class Command(Substitution):
    """What a command prints, such as xacro."""

    def __init__(self, command: object, *, on_stderr: object = "fail") -> None:
        self._command, self._on_stderr = command, on_stderr

    def perform(self, context: LaunchContext) -> str:
        """Returns what it prints; it fails if it says an error, too, unless the launch file lets it."""
        text = text_of(context, self._command)
        try:
            words = shlex.split(text)
            ran = subprocess.run(words, env=context.environment, capture_output=True, text=True, check=False)  # noqa: S603 - the launch file is code, too
        except (OSError, ValueError) as exc:
            raise NotDone(f"the command {text!r} cannot be run: {exc}") from exc
        if ran.returncode or (ran.stderr and text_of(context, self._on_stderr) == "fail"):
            said = ran.stderr.strip().splitlines() or [f"it ends with status {ran.returncode}"]
            raise NotDone(f"the command {text!r} fails: {said[-1][:300]}")
        return ran.stdout


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


class IfCondition:
    """Holds if a text is true."""

    def __init__(self, predicate_expression: object) -> None:
        self._text = predicate_expression

    def evaluate(self, context: LaunchContext) -> bool:
        """Returns whether it holds."""
        return truth_of(text_of(context, self._text))


class UnlessCondition(IfCondition):
    """Holds if a text is false."""

    def evaluate(self, context: LaunchContext) -> bool:
        """Returns whether it holds."""
        return not super().evaluate(context)


class LaunchConfigurationEquals(IfCondition):
    """Holds if a launch configuration has a value; None for one that is not set."""

    def __init__(self, launch_configuration_name: str, expected_value: object) -> None:
        self._name, self._expected = launch_configuration_name, expected_value

    def evaluate(self, context: LaunchContext) -> bool:
        """Returns whether it holds."""
        expected = None if self._expected is None else text_of(context, self._expected)
        return context.launch_configurations.get(self._name) == expected


class LaunchConfigurationNotEquals(LaunchConfigurationEquals):
    """Holds if a launch configuration has another value."""

    def evaluate(self, context: LaunchContext) -> bool:
        """Returns whether it holds."""
        return not super().evaluate(context)
