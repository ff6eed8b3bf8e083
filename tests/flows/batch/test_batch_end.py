"""A batch that was stopped while nobody worked on it is closed by whoever asks, and only then."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pydantic import JsonValue

from flows.batch.batch_end import close_if_stopped, with_audit
from flows.pipeline.batch_run import run_batch
from flows.pipeline.stage_report import batch_report
from flows.resources.kinds import cancel_resource, describe_resource, list_resources
from specs.data.episode import EpisodeResult
from specs.errors import BucketNotFound, DocumentError, StageFailed
from specs.field_types import OutputLocation
from tasks.simulate.batch.batch_jobs import cancel_batch, cancel_job
from tasks.simulate.batch.batch_record import OpenBatch, time_out
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.simulate.batch.chunk_store import begin_chunk, committed_chunk
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim
from tests.factories.planned_batches import all_pass, begun, plan

BATCH = "simulation-job-batch"


@pytest.fixture
def left(file_store: Store) -> OpenBatch:
    """Six jobs in chunks of two: the first chunk is committed, the second was begun, the third was not."""
    batch = begun(file_store, plan(file_store, lanes=2))
    run_chunk(batch, 0, all_pass, lanes=2, left_s=9.0)
    begin_chunk(file_store, batch.id, 1, 0.0)
    return batch


def results(batch: OpenBatch) -> pa.Table:
    key = str(batch.record().detail["results_url"]).removeprefix(batch.store.url + "/")
    return pq.read_table(pa.BufferReader(batch.store.get(key).body))


def test_cancelling_a_batch_that_nobody_works_on_closes_it_with_the_rows_of_what_was_done(left: OpenBatch):
    cancel_job(left.store, f"{left.id}/3")
    cancel_resource(left.store, left.record().arn)
    assert left.record().status == "Canceled"
    table = results(left)
    assert table.column("status").to_pylist() == ["Completed"] * 2 + ["Canceled"] * 4
    assert table.column("failure_code").to_pylist() == ["", "", "BatchCanceled", "", "BatchCanceled", "BatchCanceled"]


ASK: dict[str, Callable[[Store, str], object]] = {
    "describe": describe_resource,
    "describe job": lambda store, arn: describe_resource(store, f"{arn.replace(BATCH, 'simulation-job')}/0"),
    "list": lambda store, _: list_resources(store, "simulation-job-batches"),
    "list jobs": lambda store, _: list_resources(store, "simulation-jobs"),
}


@pytest.mark.parametrize("ask", list(ASK))
def test_whoever_asks_about_a_batch_that_was_stopped_and_left_finds_it_ended(left: OpenBatch, ask: str):
    time_out(left)
    ASK[ask](left.store, left.record().arn)
    assert left.record().status == "TimedOut"
    assert results(left).num_rows == 6


def test_cancelling_again_closes_a_batch_whose_process_died_before_it_could(left: OpenBatch):
    cancel_batch(left.store, left.id)
    cancel_resource(left.store, left.record().arn)
    assert left.record().status == "Canceled"


def test_a_batch_that_somebody_works_on_is_left_to_him(left: OpenBatch):
    cancel_batch(left.store, left.id)
    with hold_claim(left.store, claim_key(BATCH, left.id), ttl_s=1.5):
        assert close_if_stopped(left.store, left.id).status == "Canceling"
    assert close_if_stopped(left.store, left.id).status == "Canceled"


def test_a_batch_that_nobody_stopped_is_left_to_be_continued(left: OpenBatch):
    assert close_if_stopped(left.store, left.id).status == "InProgress"
    assert describe_resource(left.store, left.record().arn).model_dump()["status"] == "InProgress"


def test_a_process_that_was_paused_meanwhile_cannot_commit_what_was_given_up(left: OpenBatch):
    cancel_batch(left.store, left.id)

    def slow(part: ChunkPart) -> list[EpisodeResult]:
        close_if_stopped(left.store, left.id)
        return all_pass(part)

    assert run_chunk(left, 1, slow, lanes=2, left_s=9.0).episodes == 2
    assert {row.status for row in committed_chunk(left.store, left.id, 1) or ()} == {"Canceled"}
    assert results(left).column("status").to_pylist()[2:4] == ["Canceled"] * 2


def test_a_batch_that_cannot_be_closed_is_told_as_it_stands_and_keeps_no_other_from_being_told(
    left: OpenBatch, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    other = begun(left.store, name="other")
    cancel_batch(left.store, left.id)

    def gone(*_: object, **__: object) -> None:
        raise BucketNotFound("there is no bucket results")

    with monkeypatch.context() as broken:
        broken.setattr("flows.batch.batch_end.write_batch_tables", gone)
        told = {
            each.model_dump()["arn"]: each.model_dump()["status"] for each in list_resources(left.store, f"{BATCH}es")
        }
        assert told == {left.record().arn: "Canceling", other.record().arn: "InProgress"}
        assert describe_resource(left.store, left.record().arn).model_dump()["status"] == "Canceling"
    assert f"batch {left.id} was stopped and cannot be closed: there is no bucket results" in caplog.text
    assert describe_resource(left.store, left.record().arn).model_dump()["status"] == "Canceled"


def test_a_settled_batch_cannot_be_cancelled_again(left: OpenBatch, tmp_path: Path):
    cancel_resource(left.store, left.record().arn)
    before = left.record()
    with pytest.raises(DocumentError, match="this one is Canceled"):
        cancel_resource(left.store, before.arn)
    assert left.record() == before


def test_on_s3_it_is_the_same(s3_store: Store):
    batch = begun(s3_store, plan(s3_store, lanes=2))
    run_chunk(batch, 0, all_pass, lanes=2, left_s=9.0)
    cancel_resource(s3_store, batch.record().arn)
    assert batch.record().status == "Canceled"
    assert results(batch).column("status").to_pylist() == ["Completed"] * 2 + ["Canceled"] * 4


def test_of_many_that_ask_at_once_one_closes_it_and_all_see_the_same_end(left: OpenBatch):
    cancel_batch(left.store, left.id)
    with ThreadPoolExecutor(4) as askers:
        list(askers.map(lambda _: close_if_stopped(left.store, left.id), range(4)))
    end = left.record()
    assert end.status == "Canceled"
    assert close_if_stopped(left.store, left.id) == end


def test_a_process_that_waited_for_a_batch_that_was_closed_meanwhile_does_nothing(left: OpenBatch):
    cancel_resource(left.store, left.record().arn)
    before = left.record()
    assert run_batch(left.store, left.id, OutputLocation(s3Bucket="results")) == before
    assert committed_chunk(left.store, left.id, 2) is None


def test_the_audit_is_one_of_the_files_that_evidence_hashes():
    detail: dict[str, JsonValue] = {"passed": 1, "sha256s": {"results.parquet": "a"}}
    audited: dict[str, JsonValue] = {"audit_url": "file:///x", "sha256s": {"audit.json": "b"}}
    digests = {"results.parquet": "a", "audit.json": "b"}
    assert with_audit(detail, audited) == {"passed": 1, "audit_url": "file:///x", "sha256s": digests}
    assert with_audit(detail, {}) == detail


@pytest.mark.parametrize("exc", [ZeroDivisionError("no such page"), StageFailed("MismatchedEtag", "no such page")])
def test_a_report_that_cannot_be_written_keeps_no_batch_from_its_end(
    left: OpenBatch, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, exc: Exception
):
    def fails(*_: object) -> None:
        raise exc

    monkeypatch.setattr("flows.batch.batch_end.report_page", fails)
    cancel_resource(left.store, left.record().arn)
    record = left.record()
    assert record.status == "Canceled"
    assert "report_url" not in record.detail
    assert str(record.detail["report_failed"]).endswith("no such page")
    assert "no report was written" in caplog.text
    assert results(left).num_rows == 6
    stage = batch_report(record, 1.0)
    assert stage.facts["alarm"] == f"There is no report: {record.detail['report_failed']}"
