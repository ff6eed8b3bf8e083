"""Before anything is shipped, verdict and evidence follow from what the owner vouches for, or nothing is shipped."""

import json
from collections.abc import Callable
from pathlib import Path
from threading import Barrier
from typing import Any

import pytest

from flows.pipeline import recount
from flows.pipeline.pipeline import authenticated_batch, deploy, judge
from flows.pipeline.recount import PlannedRun, recount_changes
from flows.pipeline.references import ParsedRun
from flows.pipeline.run_gate import gate_answer, read_baseline, read_gate_answer
from specs.errors import StageFailed
from specs.pipeline.document import PipelineSpec
from tasks.simulate.batch.batch_record import KIND, plan_of
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.storage.base.keys import job_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tests.factories.judged_batches import courier, delivery, document, ended, run_of
from tests.factories.planned_batches import mixed

_PATIENCE_S = 60.0
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
    both, count = Barrier(2, timeout=_PATIENCE_S), recount.count_batch
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


def test_counts_that_do_not_follow_are_named(run: Run):
    run.edit(KIND, run.batch.id, lambda detail: detail["counts"].update(successes=1))
    (line,) = run.changes()
    assert "says counts {'episodes': 80, 'successes': 1" in line


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
        authenticated_batch(run.work, read)
    assert authenticated_batch(run.work, None) is None
