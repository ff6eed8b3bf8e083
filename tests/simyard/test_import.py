"""`import simyard` is quick: nothing that takes a second, and few modules."""

import json
import subprocess
import sys

import simyard
from tests.repository import ROOT

HEAVY = {"jax", "jaxlib", "prefect", "mujoco", "scipy", "numpy", "pyarrow", "pandas", "polars", "pydantic", "fsspec"}
# Counted when this was written: 50 more than Python itself, all of the standard library.
MOST_MODULES = 80


def imported(code: str) -> list[str]:
    """Returns the modules that a new process has imported besides those of Python's own start."""
    lines = f"import sys, json; before = set(sys.modules)\n{code}\nprint(json.dumps(sorted(set(sys.modules) - before)))"
    done = subprocess.run([sys.executable, "-c", lines], cwd=ROOT, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def test_it_imports_nothing_heavy_and_little_else():
    modules = imported("import simyard")
    assert sorted(HEAVY.intersection(modules)) == []
    assert len(modules) <= MOST_MODULES


def test_a_document_is_checked_without_the_simulator_and_without_prefect():
    modules = imported("import simyard; simyard.validate('examples/worlds-only.yaml')")
    assert sorted({"jax", "prefect", "mujoco", "scipy"}.intersection(modules)) == []


def test_each_name_that_is_offered_is_there():
    assert [name for name in simyard.__all__ if not callable(getattr(simyard, name))] == []
