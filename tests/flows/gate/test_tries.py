"""A gate that is asked again on other episodes counts its attempts with one listing, and sticks to what it said."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest

from flows.pipeline.run_gate import (
    GateAnswer,
    attempts_before,
    attempts_name,
    episodes_name,
    gate_answer,
    note_attempt,
    read_gate_answer,
)
from specs.data.episode import ApplicationLaunch, EpisodeResult
from specs.pipeline.gate_section import Gate
from tasks.results.gate.evidence import read_evidence
from tasks.simulate.batch.batch_record import plan_of
from tasks.simulate.batch.chunk_run import ChunkPart, Simulate
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance
from tests.factories.episodes import collided, passed
from tests.factories.judged_batches import courier, delivery, ended, run_of

GATE = Gate.model_validate({"successRate": {"atLeast": 0.9}})
OTHER = Gate.model_validate({"successRate": {"atLeast": 0.8}})


def half(part: ChunkPart) -> list[EpisodeResult]:
    return [(collided if each.index % 2 else passed)(each.index) for each in part.chunk.requests]


class Nights:
    """Runs of one document, each on other seeds if it is said so."""

    def __init__(self, store: Store, folder: Path) -> None:
        self.store = store
        self.robot, self.scenario = courier(store, folder, "one"), delivery(store, folder)

    def batch(
        self,
        night: str,
        first_seed: int = 0,
        *,
        robot: ApplicationLaunch | None = None,
        simulate: Simulate = half,
        lanes: int = 40,
    ) -> JobRecord:
        seeds, name = tuple(range(first_seed, first_seed + 40)), f"batch-{night}"
        return ended(
            self.store,
            robot or self.robot,
            scenario=self.scenario,
            simulate=simulate,
            name=name,
            seeds=seeds,
            lanes=lanes,
        )

    def run(self, night: str, first_seed: int = 0, gate: Gate = GATE, **more: Any) -> GateAnswer:  # noqa: ANN401 - what a batch takes
        batch = self.batch(night, first_seed, **more)
        return gate_answer(gate, batch, self.store, run_of(self.store, f"run-{night}"))


@pytest.fixture
def nights(file_store: Store, tmp_path: Path) -> Nights:
    return Nights(file_store, tmp_path)


def test_a_third_attempt_on_other_episodes_says_what_it_does_to_the_error(nights: Nights):
    assert nights.run("mon", 0).attempts == ()
    assert nights.run("tue", 100).attempts == (0.025,)
    third = nights.run("wed", 200, simulate=lambda part: [passed(each.index) for each in part.chunk.requests])
    assert third.verdict == "PASS"
    assert third.sentence.splitlines()[-1] == (
        "try 3 of this gate on other episodes, none passed before: a false PASS by chance up to 3 x 2.5 % = 7.5 %"
    )
    assert read_evidence(nights.store, third.batch).tries == 2


def test_the_same_episodes_judged_again_are_no_new_attempt(nights: Nights):
    assert [nights.run(night, 0, lanes=lanes).attempts for night, lanes in (("mon", 40), ("tue", 40), ("wed", 16))] == [
        (),
        (),
        (),
    ]


def test_a_pass_leaves_no_attempt(nights: Nights):
    nights.run("mon", 0, simulate=lambda part: [passed(each.index) for each in part.chunk.requests])
    assert nights.run("tue", 100).attempts == ()


@pytest.mark.parametrize("other", ["gate", "robot"])
def test_another_bar_or_another_bundle_begins_anew(nights: Nights, tmp_path: Path, other: str):
    nights.run("mon", 0)
    robot = courier(nights.store, tmp_path, "two") if other == "robot" else None
    assert nights.run("tue", 100, OTHER if other == "gate" else GATE, robot=robot).attempts == ()


def test_another_confidence_is_another_attempt_at_the_same_gate(nights: Nights):
    surer, less = (Gate.model_validate({"successRate": {"atLeast": 0.9, "confidence": each}}) for each in (0.99, 0.9))
    nights.run("mon", 0, surer)
    nights.run("tue", 100, less)
    third = nights.run("wed", 200)
    assert third.attempts == (0.005, 0.05)
    assert third.sentence.endswith("by chance up to 1 x 0.5 % + 1 x 2.5 % + 1 x 5 % = 8 %")


def test_the_same_episodes_at_several_confidences_count_once_by_the_least_sure(nights: Nights):
    for night, confidence in (("mon", 0.99), ("tue", 0.9), ("wed", 0.95)):
        nights.run(night, 0, Gate.model_validate({"successRate": {"atLeast": 0.9, "confidence": confidence}}))
    assert nights.run("thu", 100).attempts == (0.05,)


def test_a_run_that_goes_on_says_what_it_said(nights: Nights, monkeypatch: pytest.MonkeyPatch):
    batch, run = nights.batch("mon"), run_of(nights.store, "run-mon")
    first = gate_answer(GATE, batch, nights.store, run)
    nights.run("tue", 100)
    assert gate_answer(GATE, batch, nights.store, run) == first
    monkeypatch.setattr(
        "flows.pipeline.run_gate._is_authentic", lambda *_: False
    )  # as on a machine without the owner's key
    assert gate_answer(GATE, batch, nights.store, run) == first
    advance(nights.store, "pipeline-run", run.id, "Completed")
    assert read_gate_answer(nights.store, run) == first


class CountedStore:
    """A store that counts what is asked of it."""

    def __init__(self, store: Store) -> None:
        self.calls = Counter[str]()
        self._store = store

    def __getattr__(self, name: str) -> Callable[..., object]:
        def request(*arguments: object) -> object:
            self.calls[name] += 1
            return getattr(self._store, name)(*arguments)

        return request


def test_a_hundred_attempts_are_counted_with_one_listing_and_no_record_is_opened(nights: Nights):
    batch, counted = nights.batch("mon"), CountedStore(nights.store)
    name, store = attempts_name(run_of(nights.store), GATE, batch, ""), cast("Store", counted)
    for number in range(100):
        note_attempt(nights.store, name, f"{number:032x}", "simb-0", 0.025)
    assert attempts_before(store, name, lambda: episodes_name(store, plan_of(batch))) == (0.025,) * 100
    assert counted.calls == {"keys": 1, "get": len(plan_of(batch).worlds_used())}
    counted.calls.clear()
    assert attempts_before(store, "0" * 32, lambda: episodes_name(store, plan_of(batch))) == ()
    assert counted.calls == {"keys": 1}
