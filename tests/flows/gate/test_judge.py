"""What a gate judges by: the tested version alone, and the same other version on the same episodes, however often."""

import hashlib
from pathlib import Path
from typing import cast

import pytest

from flows.pipeline.baselines import NoBaseline, find_baseline
from flows.pipeline.run_gate import BatchJudgement, gate_answer, gate_material, read_baseline, tested_facts
from flows.pipeline.tested_batch import candidates
from specs.data.episode import ApplicationLaunch, EpisodeResult
from specs.errors import ResourceNotFound, StageFailed
from specs.pipeline.gate_section import Gate, NoWorseThan
from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody
from tasks.results.gate.evidence import Baseline, read_evidence
from tasks.results.gate.gate_verdict import judge
from tasks.simulate.batch.batch_record import plan_of
from tasks.simulate.batch.chunk_run import ChunkPart
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
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
