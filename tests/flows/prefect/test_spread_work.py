"""A batch whose workers are on other machines: what they are handed, and what is left once they are not heard of."""

import pytest

from flows.prefect import spread_work
from flows.prefect.spread_work import _SpreadBatch
from specs.field_types import OutputLocation
from specs.settings import Workers
from tasks.simulate.batch.batch_jobs import cancel_batch
from tasks.simulate.batch.chunk_store import authenticated_bytes, begin_chunk, chunk_numbers, committed_chunk
from tasks.simulate.batch.metrics import BatchMeter
from tasks.storage.base.keys import chunk_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.authenticator import BatchAuthenticator
from tests.factories.episodes import passed
from tests.factories.planned_batches import begun


@pytest.mark.parametrize("canceled", [True, False])
def test_a_chunk_that_a_lost_worker_was_at_is_given_up_once_the_batch_is_stopped(
    file_store: Store, monkeypatch: pytest.MonkeyPatch, *, canceled: bool
) -> None:
    monkeypatch.setattr(spread_work, "on_workers", lambda *_: None)
    batch = begun(file_store)
    begin_chunk(file_store, batch.id, 0, 0.0)
    if canceled:
        cancel_batch(file_store, batch.id)
    spread_work.spread_batch(batch, OutputLocation(s3Bucket="out"), Workers(kind="dask"))
    assert chunk_numbers(file_store, batch.id).committed == ({0} if canceled else set())
    assert {row.status for row in committed_chunk(file_store, batch.id, 0) or ()} == (
        {"Canceled"} if canceled else set()
    )


def test_a_chunk_that_nobody_vouches_for_is_handed_out(file_store: Store) -> None:
    batch, strangers = begun(file_store), BatchAuthenticator(b"k" * 32, "another", "plan")
    rows = [passed(each.index) for each in batch.layout.chunk(0).requests]
    file_store.put(chunk_key(batch.id, 0), authenticated_bytes(rows, 0, strangers))
    work = _SpreadBatch(batch, OutputLocation(s3Bucket="out"), lambda *_: None, BatchMeter())
    assert (work.left, work.done, work.missing((0,))) == ([*range(batch.layout.chunks)], 0, (0,))
