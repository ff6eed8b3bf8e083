"""A batch that was really simulated is counted again: by who has the key, by who has not, and after an attack."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from threading import Barrier
from typing import Any

import pytest

from flows.batch.batch_end import write_report_page
from flows.pipeline import recount
from flows.pipeline.pipeline import _judge_and_deploy, authenticated_batch, deploy, judge
from flows.pipeline.recount import PlannedRun, authenticated_record, count_batch, recount_changes, sample_changes
from flows.pipeline.references import ParsedRun, Resolved
from flows.pipeline.run_gate import gate_answer, read_baseline, read_gate_answer
from flows.pipeline.world_imports import ImportedWorld
from specs.errors import StageFailed
from specs.pipeline.document import PipelineSpec
from specs.pipeline.gate_section import Gate
from tasks.simulate.batch.batch_record import KIND, OpenBatch, load_batch, plan_of
from tasks.simulate.batch.chunk_store import authenticated_bytes, committed_chunk, stored_chunk
from tasks.simulate.batch.provenance import is_sealed
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.storage.base.keys import chunk_key, job_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.authenticator import BatchAuthenticator
from tasks.storage.jobs.records import JobRecord, read
from tests.factories.batches import closed_batch, pushing_plan
from tests.factories.judged_batches import courier, delivery, document, ended, run_of
from tests.factories.planned_batches import mixed
from tests.factories.worlds import apartment

GATE = Gate.model_validate({"successRate": {"atLeast": 0.5}})


@pytest.fixture
def closed(file_store: Store) -> OpenBatch:
    return closed_batch(file_store, pushing_plan(file_store, audit=4))


def planned(batch: OpenBatch) -> PlannedRun:
    """Returns what the batch's document asks for."""
    return PlannedRun(batch.plan, recorded_location(batch.record()))


def edited(batch: OpenBatch, change: Callable[[dict[str, Any]], None]) -> JobRecord:
    """Returns the batch's record as somebody has changed it in the store."""
    key = job_key(KIND, batch.id)
    record = json.loads(batch.store.get(key).body)
    change(record["detail"])
    batch.store.put(key, json.dumps(record).encode())
    return read(batch.store, KIND, batch.id)


def elsewhere(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Lets this be a machine that does not have the owner's key."""
    monkeypatch.setenv("SIMYARD_OWNER_KEY", str(folder / "elsewhere"))


@pytest.mark.long
def test_what_the_owner_sealed_is_believed_and_what_was_added_is_not(closed: OpenBatch):
    assert is_sealed(closed.record(), closed.authenticator)
    record = edited(closed, lambda detail: detail.update(passed=999))
    vouched = authenticated_record(record, closed.store, GATE, lambda: planned(closed))
    assert vouched.detail["counts"] == record.detail["counts"]
    forged = edited(closed, lambda detail: detail.update(stopped_early={"left_out": 3}))
    assert not is_sealed(forged, closed.authenticator)


def test_counted_again_it_is_what_its_record_says(closed: OpenBatch):
    found = count_batch(closed.record(), closed.store, GATE, planned(closed))
    assert found.changes == []
    assert sample_changes(found.batch, found.bundles, 3) == []


@pytest.mark.long
def test_without_the_key_all_is_simulated_anew_and_vouched_for_from_then_on(
    closed: OpenBatch, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    elsewhere(monkeypatch, tmp_path)
    batch = load_batch(closed.store, closed.id)
    assert not is_sealed(batch.record(), batch.authenticator)
    found = authenticated_record(batch.record(), batch.store, GATE, lambda: planned(batch))
    assert found.detail["counts"] == closed.record().detail["counts"]
    for number in range(batch.layout.chunks):
        chunk = stored_chunk(batch.store, batch.id, number, batch.authenticator)
        assert chunk is not None
        assert chunk.authentic


@pytest.mark.long
def test_without_the_key_a_forged_row_is_named(closed: OpenBatch, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    elsewhere(monkeypatch, tmp_path)
    rows = committed_chunk(closed.store, closed.id, 1) or []
    forged = [row.model_copy(update={"path_length_m": row.path_length_m + 1e-9}) for row in rows[:1]] + rows[1:]
    strangers = BatchAuthenticator(b"k" * 32, closed.id, closed.layout.plan_digest)
    closed.store.put(chunk_key(closed.id, 1), authenticated_bytes(forged, 1, strangers))
    with pytest.raises(StageFailed, match=f"episode {rows[0].index} says path_length_m"):
        authenticated_record(closed.record(), closed.store, GATE, lambda: planned(closed))


def test_people_are_told_of_results_that_nobody_here_vouches_for(
    closed: OpenBatch, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    arn, page = closed.record().arn, tmp_path / "report.html"
    assert write_report_page(closed.store, arn, page).notice == ""
    elsewhere(monkeypatch, tmp_path)
    told = write_report_page(closed.store, arn, page).notice
    assert told.startswith(f"{closed.id}: this machine's key does not vouch for these results: ")
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.parametrize("name", ["counts", "sha256s", "metadata", "audit"])
def test_each_fact_that_was_edited_is_named_with_what_was_computed(closed: OpenBatch, name: str):
    def change(detail: dict[str, Any]) -> None:
        detail[name] = {**detail[name], next(iter(detail[name])): "forged"}

    record = edited(closed, change)
    with pytest.raises(StageFailed, match=f"{closed.id}.json says {name} .*forged.*; computed: "):
        authenticated_record(record, closed.store, GATE, lambda: planned(closed))


def test_another_plan_than_the_documents_is_refused(closed: OpenBatch):
    longer = closed.plan.model_copy(update={"timeout_s": 601.0})
    with pytest.raises(StageFailed, match="says the plan"):
        count_batch(closed.record(), closed.store, GATE, planned(closed)._replace(plan=longer))


def test_a_chunk_that_is_gone_is_simulated_again(closed: OpenBatch):
    closed.store.delete(chunk_key(closed.id, 0))
    assert count_batch(closed.record(), closed.store, GATE, planned(closed)).changes == []


def test_the_sample_finds_rows_that_were_vouched_for_and_are_wrong(closed: OpenBatch):
    found = count_batch(closed.record(), closed.store, GATE, planned(closed))
    closed.store.delete(chunk_key(closed.id, 0))
    rows = committed_chunk(closed.store, closed.id, 1) or []
    wrong = [row.model_copy(update={"path_length_m": 1.0}) for row in rows]
    closed.store.delete(chunk_key(closed.id, 1))
    body = authenticated_bytes(wrong, 1, closed.authenticator)
    closed.store.put(chunk_key(closed.id, 1), body)
    count_batch(closed.record(), closed.store, GATE, planned(closed))
    told = sample_changes(found.batch, found.bundles, 16)
    assert "says path_length_m 1.0, computed " in told[0]
    assert told[-1].endswith("of 16 episodes came out otherwise when they were simulated again")


PIPELINE = document({"successRate": {"atLeast": 0.9}, "collisionRate": {"atMost": 0.1}})
COMPARED = document({"noWorseThan": {"applicationVersion": "1", "margin": 0.06}})


class Run:
    """A run whose batch was judged; its rows were never simulated, so that none is drawn to be simulated again."""

    def __init__(self, store: Store, batch: JobRecord, spec: PipelineSpec, monkeypatch: pytest.MonkeyPatch) -> None:
        for module in ("flows.pipeline.recount", "flows.pipeline.pipeline"):
            monkeypatch.setattr(
                f"{module}.planned_run", lambda *_: PlannedRun(plan_of(batch), recorded_location(batch))
            )
        monkeypatch.setattr("flows.pipeline.recount.sample_changes", lambda *_: [])
        self.store, self.batch, self.spec, self.record = store, batch, spec, run_of(store)
        self.work = ParsedRun(spec, ".", store, self.record)
        judge(self.work, batch)

    def changes(self) -> list[str]:
        return recount_changes(self.work, self.batch)

    def edit(self, kind: str, name: str, change: Callable[[dict[str, Any]], None]) -> None:
        record = json.loads(self.store.get(job_key(kind, name)).body)
        change(record["detail"])
        self.store.put(job_key(kind, name), json.dumps(record).encode())

    def edit_run(self, change: Callable[[dict[str, Any]], None]) -> None:
        self.edit("pipeline-run", self.record.id, change)


@pytest.fixture
def run(file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    batch = ended(file_store, courier(file_store, tmp_path, "one"), scenario=delivery(file_store, tmp_path), audit=0)
    return Run(file_store, batch, PIPELINE, monkeypatch)


@pytest.fixture
def failed(file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    robot, scenario = courier(file_store, tmp_path, "one"), delivery(file_store, tmp_path)
    return Run(file_store, ended(file_store, robot, scenario=scenario, simulate=mixed, audit=0), PIPELINE, monkeypatch)


@pytest.fixture
def compared(file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    scenario = delivery(file_store, tmp_path)
    old, new = (courier(file_store, tmp_path, text) for text in ("old", "new"))
    ended(file_store, old, scenario=scenario, name="before", audit=0)
    run = Run(file_store, ended(file_store, new, scenario=scenario, name="now", audit=0), COMPARED, monkeypatch)
    monkeypatch.setattr("flows.pipeline.recount.compared_digest", lambda *_: old.digest)
    return run


@pytest.mark.parametrize("name", ["run", "compared"])
def test_what_was_judged_is_found_again(name: str, request: pytest.FixtureRequest):
    assert request.getfixturevalue(name).changes() == []


def test_an_imported_world_that_is_not_its_sources_is_named(run: Run):
    world, driven = next(iter(plan_of(run.batch).world_digests.items()))
    generation, _, name = world.partition("/")
    imported = ImportedWorld(name, apartment(generation=generation, name=name))
    assert imported.digest != driven
    run.work = replace(run.work, found=Resolved(imported=[imported]))
    assert run.changes() == [f"world {world} has the SHA-256 {driven}; its source gives {imported.digest}"]


def test_a_document_without_a_gate_is_not_recounted(file_store: Store):
    spec = PipelineSpec.model_validate({"name": "n", "deployment": PIPELINE.deployment})
    assert recount_changes(ParsedRun(spec, ".", file_store, run_of(file_store)), None) == []


def test_a_gate_that_has_not_answered_ships_nothing(run: Run):
    run.edit_run(lambda detail: detail.pop("gate"))
    (line,) = run.changes()
    assert line.endswith("says no gate's answer")
    (report,) = deploy(run.work, run.batch)
    assert report.status == "Refused"
    assert "the document has a gate" in report.summary


def test_a_gate_without_a_batch_ships_nothing(run: Run):
    assert recount_changes(run.work, None) == ["there is no batch that the gate could have judged"]


def test_a_verdict_that_does_not_follow_is_named_with_the_one_that_does(failed: Run):
    failed.edit_run(lambda detail: detail["gate"].update(verdict="PASS"))
    (line,) = failed.changes()
    assert "says the verdict PASS; computed: FAIL" in line


def test_evidence_that_does_not_follow_is_named(run: Run):
    run.edit_run(lambda detail: detail["gate"].update(evidence="0" * 64))
    (line,) = run.changes()
    assert f"evidence.json has the SHA-256 {'0' * 64}; computed: " in line


def test_a_sample_is_simulated_again_while_the_batch_is_counted(run: Run, monkeypatch: pytest.MonkeyPatch):
    both, count = Barrier(2), recount.count_batch
    monkeypatch.setattr(recount, "sample_changes", lambda *_: [str(both.wait() < 0)])
    monkeypatch.setattr(recount, "count_batch", lambda *given: (both.wait(), count(*given))[1])
    assert run.changes() == ["False"]


def test_a_sample_of_a_batch_whose_chunks_nobody_vouches_for_yet_is_simulated_again_after_the_count(
    run: Run, monkeypatch: pytest.MonkeyPatch
):
    asked: list[str] = []

    def sample(*_: object) -> list[str]:
        asked.append("sample")
        if len(asked) == 1:
            raise StageFailed("MismatchedEtag", "the chunk is gone")
        return ["an episode came out otherwise"]

    monkeypatch.setattr(recount, "sample_changes", sample)
    assert run.changes() == ["an episode came out otherwise"]
    assert len(asked) == 2


def test_of_what_was_counted_otherwise_the_sample_tells_nothing(run: Run, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(recount, "sample_changes", lambda *_: ["an episode came out otherwise"])
    run.edit(KIND, run.batch.id, lambda detail: detail["counts"].update(successes=1))
    (line,) = run.changes()
    assert "says counts" in line


def test_a_sample_that_breaks_hides_nothing_of_what_was_counted_otherwise(run: Run, monkeypatch: pytest.MonkeyPatch):
    def breaks(*_: object) -> list[str]:
        raise RuntimeError("a defect")

    monkeypatch.setattr(recount, "sample_changes", breaks)
    with pytest.raises(RuntimeError, match="a defect"):
        run.changes()
    run.edit(KIND, run.batch.id, lambda detail: detail["counts"].update(successes=1))
    (line,) = run.changes()
    assert "says counts" in line


def test_counts_that_do_not_follow_are_named_and_nothing_is_shipped(run: Run):
    run.edit(KIND, run.batch.id, lambda detail: detail["counts"].update(successes=1))
    (line,) = run.changes()
    assert "says counts {'episodes': 80, 'successes': 1" in line
    (report,) = deploy(run.work, run.batch)
    assert report.status == "Refused"
    assert line in report.summary


def test_an_answer_that_nobody_vouches_for_is_given_again_or_refused(failed: Run):
    gate, answer = failed.spec.gate, read_gate_answer(failed.store, failed.record)
    assert gate
    failed.edit_run(lambda detail: detail.pop("gateSeal"))
    assert gate_answer(gate, failed.batch, failed.store, failed.record) == answer
    failed.edit_run(lambda detail: detail["gate"].update(verdict="PASS"))
    with pytest.raises(StageFailed, match=r"says the verdict PASS .* computed: FAIL"):
        gate_answer(gate, failed.batch, failed.store, failed.record)


def test_a_baseline_that_nobody_vouches_for_is_none(compared: Run):
    assert read_baseline(compared.store, compared.record)
    compared.edit_run(lambda detail: detail["baseline"].update(version="2"))
    assert read_baseline(compared.store, compared.record) is None
    assert compared.changes() != []


def test_a_compared_batch_that_was_edited_is_no_baseline(compared: Run):
    other = read_baseline(compared.store, compared.record)
    assert other
    compared.edit(KIND, other.batch, lambda detail: detail["counts"].update(successes=1))
    (line,) = compared.changes()
    assert f"nobody vouches for the results of '{other.batch}'" in line


def test_only_what_is_vouched_for_is_handed_to_the_gate(run: Run):
    run.edit(KIND, run.batch.id, lambda detail: detail["counts"].update(successes=1))
    read = run.batch.model_copy(update={"detail": {**run.batch.detail, "counts": {"successes": 1}}})
    with pytest.raises(StageFailed, match="says counts"):
        _judge_and_deploy(run.work, read, ())
    assert authenticated_batch(run.work, None) is None
