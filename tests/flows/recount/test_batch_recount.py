"""A batch that was really simulated is counted again: by who has the key, by who has not, and after an attack."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from flows.batch.batch_end import write_report_page
from flows.pipeline.recount import PlannedRun, authenticated_record, count_batch, sample_changes
from specs.errors import StageFailed
from specs.pipeline.gate_section import Gate
from tasks.simulate.batch.batch_record import KIND, OpenBatch, load_batch
from tasks.simulate.batch.chunk_store import authenticated_bytes, committed_chunk, stored_chunk
from tasks.simulate.batch.provenance import is_sealed
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.storage.base.keys import chunk_key, job_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.authenticator import BatchAuthenticator
from tasks.storage.jobs.records import JobRecord, read
from tests.factories.batches import closed_batch, pushing_plan

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
        assert chunk.vouched


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
