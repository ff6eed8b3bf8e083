"""Names of metrics are read from sources; where they are not written out, nothing is known."""

from pathlib import Path

import pytest

from tasks.simulate.application.declared_metrics import declared_metrics
from tests.repository import ROOT

KNOWN = {
    'class S:\n    def metrics(self, state):\n        return {"a_s": state.a, "b": 1}': {"a_s", "b"},
    "class S:\n    def metrics(self, state):\n        return dict(a=1)": {"a"},
    'class S:\n    def metrics(self, state):\n        if state: return {"a": 1}\n        return {"b": 1}': {"a", "b"},
    'def metrics(state):\n    found = {"a": 1}\n    found["b"] = 2\n    return found': {"a", "b"},
    "class S(NamedTuple):\n    goal: int": set[str](),
}
UNKNOWN = (
    "class S:\n    def metrics(self, state):\n        return {f'{x}_s': 1 for x in state}",
    "class S:\n    def metrics(self, state):\n        return {**state.sums, 'a': 1}",
    "class S:\n    def metrics(self, state):\n        return measure(state)",
    "def metrics(state):\n    found = {'a': 1}\n    found.update(state)\n    return found",
    "def metrics(state):\n    found = {'a': 1}\n    for x in state: found[x] = 1\n    return found",
    "class S:\n    metrics = measure",
    "class S(Base):\n    pass",
    "def scenario(environment):\n    return SimpleNamespace(place=place, metrics=measure)",
    "def scenario(environment):\n    setattr(S, 'metrics', measure)",
    "from .sums import metrics",
    "class S:\n    def __getattr__(self, name): ...",
    "def (",
)


def bundle(folder: Path, source: str) -> Path:
    (folder / "patrol").mkdir()
    (folder / "patrol/rounds.py").write_text(source)
    return folder


@pytest.mark.parametrize("source", KNOWN)
def test_names_that_are_written_out_are_known(tmp_path: Path, source: str):
    assert declared_metrics(bundle(tmp_path, source)) == KNOWN[source]


@pytest.mark.parametrize("source", UNKNOWN)
def test_names_that_may_be_others_are_not_known(tmp_path: Path, source: str):
    assert declared_metrics(bundle(tmp_path, source)) is None


def test_the_shipped_scenarios_say_what_they_measure():
    covered = declared_metrics(ROOT / "applications/coverage")
    assert covered == {"covered_share", "covered_m2", "time_to_50_percent_s", "time_to_90_percent_s"}
    assert declared_metrics(ROOT / "applications/delivery") == frozenset()
