"""What a gate judges by: the tested version alone, and the same other version on the same episodes, however often."""

import hashlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest

from flows.pipeline.baselines import NoBaseline, find_baseline
from flows.pipeline.run_gate import (
    BatchJudgement,
    GateAnswer,
    attempts_before,
    attempts_name,
    episodes_name,
    gate_answer,
    gate_material,
    note_attempt,
    read_baseline,
    read_gate_answer,
    tested_facts,
)
from flows.pipeline.tested_batch import candidates
from specs.data.episode import ApplicationLaunch, EpisodeResult
from specs.errors import ResourceNotFound, StageFailed
from specs.pipeline.gate_section import Gate, NoWorseThan
from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody
from tasks.results.gate.evidence import Baseline, read_evidence
from tasks.results.gate.gate_verdict import judge
from tasks.simulate.batch.batch_record import plan_of
from tasks.simulate.batch.chunk_run import ChunkPart, Simulate
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance
from tasks.worlds.job.generation_job import run_generation_job
from tests.factories.episodes import collided, passed
from tests.factories.judged_batches import courier, delivery, ended, run_of
from tests.factories.planned_batches import mixed
from tests.repository import ROOT

RULE = NoWorseThan(applicationVersion="1", margin=0.06)
GATE = Gate(noWorseThan=RULE)
EXAMPLES = ROOT / "examples"


class Shelf:
    """Versions 1 and 2 of courier, and a scenario."""

    def __init__(self, store: Store, folder: Path) -> None:
        self.old, self.new = (courier(store, folder, text) for text in ("old", "new"))
        self.scenario = delivery(store, folder)


@pytest.fixture
def shelf(file_store: Store, tmp_path: Path) -> Shelf:
    return Shelf(file_store, tmp_path)


def old_collides(shelf: Shelf):
    """Returns a simulation in which every tenth episode of the old version collides."""

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        return [
            (collided if each.robot == shelf.old and each.index % 10 == 0 else passed)(each.index)
            for each in part.chunk.requests
        ]

    return simulate


def test_both_versions_in_one_batch_are_compared_there(file_store: Store, shelf: Shelf):
    ended(file_store, shelf.old, scenario=shelf.scenario, name="earlier")
    batch = ended(file_store, shelf.new, shelf.old, scenario=shelf.scenario, simulate=old_collides(shelf))
    found = find_baseline(RULE, batch, file_store)
    assert isinstance(found, Baseline)
    assert (found.batch, found.digest) == (batch.id, shelf.old.digest)
    verdict = judge(GATE, gate_material(GATE, batch, file_store, found))
    assert verdict.rules[0].facts["gains"] == 8
    assert verdict.rules[0].facts["losses"] == 0
    assert verdict.rules[0].counted == 80


def test_of_a_batch_with_both_versions_only_the_tested_one_is_counted(file_store: Store, shelf: Shelf):
    gate = Gate.model_validate(
        {"successRate": {"atLeast": 0.9}, "noWorseThan": {"applicationVersion": "1", "margin": 0}}
    )
    batch = ended(file_store, shelf.new, shelf.old, scenario=shelf.scenario, simulate=old_collides(shelf))
    found = gate_material(gate, batch, file_store, find_baseline(RULE, batch, file_store))
    assert (found.counts.episodes, found.counts.successes) == (80, 80)


def test_else_the_newest_batch_that_drove_it_on_the_same_episodes(file_store: Store, shelf: Shelf):
    scenario = shelf.scenario
    ended(file_store, shelf.old, scenario=scenario, name="first")
    second = ended(file_store, shelf.old, scenario=scenario, name="second", simulate=mixed)
    ended(file_store, shelf.new, scenario=scenario, name="another version")
    ended(file_store, shelf.old, scenario=scenario, name="other seeds", seeds=(99,))
    ended(
        file_store, shelf.old, scenario=delivery(file_store, Path(file_store.url[7:]).parent, "other"), name="scenario"
    )
    batch = ended(file_store, shelf.new, scenario=scenario, name="now")
    found = find_baseline(RULE, batch, file_store)
    assert isinstance(found, Baseline)
    assert found.batch == second.id


def generated(store: Store, token: str) -> dict[str, str]:
    """Returns the digests of worlds that a run of a document generates, always from the same template and seed."""
    template = TemplateBody.model_validate_json((EXAMPLES / "templates/two-rooms.json").read_bytes())
    asked = CreateWorldGenerationJobRequest.model_validate(
        {"template": "arn:simyard:world-template:0123456789ab:t", "worldCount": {"floorplanCount": 2}}
    )
    record = run_generation_job(store, asked, template, seed=7, token=token, progress=lambda *_: None, workers=1)
    names = cast("list[str]", record.detail["worlds"])
    bodies = {name: store.get(world_key(*name.split("/"))).body for name in names}
    return {name: hashlib.sha256(body).hexdigest() for name, body in bodies.items()}


def test_worlds_that_another_run_generated_again_are_the_same_worlds(file_store: Store, shelf: Shelf):
    first, second = (generated(file_store, token) for token in ("yesterday", "today"))
    assert not set(first.values()) & set(second.values())  # each document names its generation

    def drove(robot: ApplicationLaunch, worlds: dict[str, str], name: str) -> JobRecord:
        used = {"worlds": tuple(worlds), "world_digests": worlds}
        return ended(file_store, robot, scenario=shelf.scenario, name=name, simulate=old_collides(shelf), **used)

    before, batch = drove(shelf.old, first, "before"), drove(shelf.new, second, "now")
    found = find_baseline(RULE, batch, file_store)
    assert isinstance(found, Baseline)
    assert found.batch == before.id
    (rule,) = judge(GATE, gate_material(GATE, batch, file_store, found)).rules
    assert (rule.counted, rule.facts["gains"], rule.facts["unpaired"]) == (80, 8, 0)


def test_where_nobody_drove_it_the_rule_is_open_and_says_what_to_do(file_store: Store, shelf: Shelf):
    batch = ended(file_store, shelf.new, scenario=shelf.scenario)
    found = find_baseline(RULE, batch, file_store)
    assert isinstance(found, NoBaseline)
    verdict = judge(GATE, gate_material(GATE, batch, file_store, found))
    assert verdict.verdict == "INCONCLUSIVE"
    assert "put both versions into createSimulationJobRequests" in verdict.sentence


def test_a_batch_that_another_owner_vouches_for_is_named_with_the_key_to_bring(
    file_store: Store, shelf: Shelf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    before = ended(file_store, shelf.old, scenario=shelf.scenario, name="before")
    monkeypatch.setenv("SIMYARD_OWNER_KEY", str(tmp_path / "fresh machine" / "key"))
    found = find_baseline(RULE, ended(file_store, shelf.new, scenario=shelf.scenario), file_store)
    assert isinstance(found, NoBaseline)
    assert f"batch {before.id} drove version 1 of courier" in found.why
    assert "bring the owner's key" in found.why


def test_a_version_that_does_not_exist_is_refused(file_store: Store, shelf: Shelf):
    batch = ended(file_store, shelf.new, scenario=shelf.scenario)
    with pytest.raises(ResourceNotFound, match="applicationVersion"):
        find_baseline(NoWorseThan(applicationVersion="7", margin=0.1), batch, file_store)


def test_the_same_version_is_compared_with_itself(file_store: Store, shelf: Shelf):
    batch = ended(file_store, shelf.old, scenario=shelf.scenario)
    assert candidates(plan_of(batch), shelf.old.digest) == {shelf.old.digest}
    verdict = judge(GATE, gate_material(GATE, batch, file_store, find_baseline(RULE, batch, file_store)))
    assert verdict.verdict == "PASS"


def test_three_versions_in_one_batch_leave_open_which_is_meant(file_store: Store, shelf: Shelf, tmp_path: Path):
    third = courier(file_store, tmp_path, "third")
    batch = ended(file_store, shelf.new, third, shelf.old, scenario=shelf.scenario)
    found = find_baseline(RULE, batch, file_store)
    assert isinstance(found, NoBaseline)
    assert "several versions of courier besides version 1" in found.why


def test_a_run_that_goes_on_compares_with_what_it_compared_with(file_store: Store, shelf: Shelf):
    before = ended(file_store, shelf.old, scenario=shelf.scenario, name="before")
    batch, run = ended(file_store, shelf.new, scenario=shelf.scenario, name="now"), run_of(file_store)

    def dies(*_: object, **__: object) -> BatchJudgement:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        gate_answer(GATE, batch, file_store, run, judged=dies)
    ended(file_store, shelf.old, scenario=shelf.scenario, name="newer", simulate=mixed)
    gate_answer(GATE, batch, file_store, run)
    baseline = read_evidence(file_store, batch.id).baseline
    assert baseline
    assert baseline.batch == before.id
    assert read_baseline(file_store, run) == baseline


def test_results_that_are_not_what_the_batch_wrote_are_not_judged(file_store: Store, shelf: Shelf):
    gate = Gate.model_validate({"collisionRate": {"atMost": 0.1}})
    batch = ended(file_store, shelf.new, scenario=shelf.scenario)
    key = str(batch.detail["results_url"]).removeprefix(file_store.url + "/")
    file_store.put(key, file_store.get(key).body + b" ")
    with pytest.raises(StageFailed, match=r"MismatchedEtag.*is not what the batch wrote"):
        gate_material(gate, batch, file_store, None)


def test_evidence_names_bundles_worlds_files_and_each_rules_numbers(file_store: Store, shelf: Shelf):
    gate = Gate.model_validate({"successRate": {"atLeast": 0.9}, "collisionRate": {"atMost": 0.1}})
    batch = ended(file_store, shelf.new, scenario=shelf.scenario)
    gate_answer(gate, batch, file_store, run_of(file_store))
    evidence = read_evidence(file_store, batch.id)
    assert evidence.rule == gate
    assert [(rule.rule, rule.verdict, rule.counted) for rule in evidence.rules] == [
        ("successRate", "PASS", 80),
        ("collisionRate", "PASS", 80),
    ]
    assert evidence.worlds == plan_of(batch).world_digests
    assert evidence.files == batch.detail["sha256s"]
    assert tested_facts(plan_of(batch), batch).robots == evidence.robots


COUNTED_GATE = Gate.model_validate({"successRate": {"atLeast": 0.9}})
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

    def run(self, night: str, first_seed: int = 0, gate: Gate = COUNTED_GATE, **more: Any) -> GateAnswer:  # noqa: ANN401 - what a batch takes
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
    assert nights.run("tue", 100, OTHER if other == "gate" else COUNTED_GATE, robot=robot).attempts == ()


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
    first = gate_answer(COUNTED_GATE, batch, nights.store, run)
    nights.run("tue", 100)
    assert gate_answer(COUNTED_GATE, batch, nights.store, run) == first
    monkeypatch.setattr(
        "flows.pipeline.run_gate._is_authentic", lambda *_: False
    )  # as on a machine without the owner's key
    assert gate_answer(COUNTED_GATE, batch, nights.store, run) == first
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
    name, store = attempts_name(run_of(nights.store), COUNTED_GATE, batch, ""), cast("Store", counted)
    for number in range(100):
        note_attempt(nights.store, name, f"{number:032x}", "simb-0", 0.025)
    assert attempts_before(store, name, lambda: episodes_name(store, plan_of(batch))) == (0.025,) * 100
    assert counted.calls == {"keys": 1, "get": len(plan_of(batch).worlds_used())}
    counted.calls.clear()
    assert attempts_before(store, "0" * 32, lambda: episodes_name(store, plan_of(batch))) == ()
    assert counted.calls == {"keys": 1}
