"""What a launch file is evaluated in: configurations, environment, packages, the processes that it starts."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple


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
            raise NotDone(f"there is no package {name!r} in the bundle or in ROS 2")
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
