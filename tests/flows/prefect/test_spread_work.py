"""A batch whose workers are on other machines, and are not heard of any more."""

import pytest

from flows.prefect import spread_work
from specs.field_types import OutputLocation
from specs.settings import Workers
from tasks.simulate.batch.batch_jobs import cancel_batch
from tasks.simulate.batch.chunk_store import begin_chunk, chunk_numbers, committed_chunk
from tasks.storage.base.store import Store
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
