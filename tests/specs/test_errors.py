"""The errors' tree: drawn as it is, and whole after a process has handed an error to another."""

import ast
import copy
import importlib
import pickle
from functools import cache
from typing import Any

import pytest

from specs import errors
from specs.base import Fault
from specs.data.run_report import PipelineReport
from specs.errors import DocumentError, SimyardError
from tests.repository import ROOT

_FOLDERS = ("specs", "tasks", "flows", "simyard")
_FAULTS = [Fault(path="a", value="1", allowed="2"), Fault(path="b", value="3", allowed="4")]
_REPORT = PipelineReport(run="run-1", name="nightly", verdict="FAIL", stages=())


@cache
def declared_errors() -> dict[str, tuple[str, str]]:
    """Returns the base and the module of each class of the tree, wherever it is declared."""
    classes = [
        (node.name, {ast.unparse(base).rpartition(".")[2] for base in node.bases}, path)
        for folder in _FOLDERS
        for path in sorted((ROOT / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    ]
    found: dict[str, tuple[str, str]] = {"SimyardError": ("", "specs.errors")}
    while new := {
        name: (next(iter(bases & found.keys())), ".".join(path.relative_to(ROOT).with_suffix("").parts))
        for name, bases, path in classes
        if name not in found and bases & found.keys()
    }:
        found |= new
    return found


def drawn_errors() -> dict[str, str]:
    """Returns the base of each class in the drawing."""
    found: dict[str, str] = {}
    above: list[tuple[int, str]] = []
    for line in (errors.__doc__ or "").splitlines():
        name = line.lstrip("│├└─ ").partition(" ")[0]
        if line.startswith(("│", "├", "└", " ", "SimyardError")) and name:
            depth = len(line) - len(line.lstrip("│├└─ "))
            above = [each for each in above if each[0] < depth]
            found[name] = above[-1][1] if above else ""
            above.append((depth, name))
    return found


_MADE_OF: dict[str, tuple[Any, ...]] = {
    "AccessRefused": ("AccessDeniedException", "no key", 401),
    "BundleCrash": ("RobotApplicationCrash", "it divides by zero", "run.py:3"),
    "PipelineNotPassed": (_REPORT,),
    "SimulatorEnded": ("ended by signal 9", None, "no memory"),
    "StageFailed": ("AccessDenied", "the bucket refuses", "arn:simyard:robot:s:r"),
    "WorldRejected": ("InternalServiceError", "no room has a door"),
}
"""What errors are made of that are not made of a text."""


def sample(name: str) -> SimyardError:
    """Returns an error of a class of the tree."""
    kind: type[SimyardError] = getattr(importlib.import_module(declared_errors()[name][1]), name)
    made_of: tuple[Any, ...] = (
        (_FAULTS, "nightly.yaml") if issubclass(kind, DocumentError) else (f"why it is a {name}",)
    )
    return kind(*_MADE_OF.get(name, made_of))


def test_every_class_of_the_tree_is_drawn_under_its_base() -> None:
    assert drawn_errors() == {name: base for name, (base, _) in declared_errors().items()}


@pytest.mark.parametrize("name", list(drawn_errors()))
def test_an_error_is_the_same_in_another_process(name: str) -> None:
    error = sample(name)
    error.add_note("of the fourth chunk")
    for again in (pickle.loads(pickle.dumps(error)), copy.copy(error)):  # noqa: S301 - made here
        assert type(again) is type(error)
        assert (str(again), again.args, vars(again)) == (str(error), error.args, vars(error))
