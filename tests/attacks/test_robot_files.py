"""Robots whose files were changed at random, driven blindly into a wall: none passes a rule about collisions.

On commit 2fa7955b 33 of 500 such robots did, and 60 more were never at a wall. Each kind of change by itself:
tests/simulate/application/test_robot_file.py.
"""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from specs.field_types import EngineName
from tests.factories.robot_mutants import Answer, answer_to, mutant

_SEEDS = 93


def answers(folder: Path, seeds: range, engine: EngineName = "mujoco") -> Counter[Answer]:
    """Returns what came of mutants; fails at the first that passed where a wall stands."""
    found = Counter[Answer]()
    for seed in seeds:
        each = mutant(np.random.default_rng(seed))
        answer = answer_to(each, folder, engine)
        assert answer != "PASS", f"seed {seed}: {each.name} with {', '.join(each.changes)}"
        found[answer] += 1
    return found


def test_a_few_of_them(tmp_path: Path):
    found = answers(tmp_path, range(27, 33))
    assert found["refused"]
    assert found["FAIL"]


@pytest.mark.long
def test_many_of_them(tmp_path: Path):
    found = answers(tmp_path, range(33, _SEEDS))
    assert min(found["refused"], found["FAIL"]) > found.total() // 5


@pytest.mark.long
@pytest.mark.parametrize(
    ("engine", "seeds"),
    [
        ("planar", range(400_000, 400_005)),
        ("mjx", range(300_000, 300_001)),
        # Each robot is compiled for itself.
        pytest.param("planar", range(400_005, 400_015), marks=pytest.mark.soak),
        pytest.param("mjx", range(300_001, 300_003), marks=pytest.mark.soak),
    ],
)
def test_some_of_them_on_the_other_engines(tmp_path: Path, engine: EngineName, seeds: range):
    found = answers(tmp_path, seeds, engine)
    assert found["FAIL"]
