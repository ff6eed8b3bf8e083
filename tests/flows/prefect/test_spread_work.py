"""Batches and searches whose workers are on other machines: what they are handed, and what is left if one is lost."""

from pathlib import Path

import pytest

from flows.prefect import spread_work
from flows.prefect.spread_work import EpisodesDone, _SpreadBatch
from specs.data.episode import EpisodeRequest
from specs.errors import StageFailed
from specs.field_types import OutputLocation
from specs.settings import Workers
from tasks.simulate.batch.batch_jobs import cancel_batch
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_store import authenticated_bytes, begin_chunk, chunk_numbers, committed_chunk
from tasks.simulate.batch.metrics import BatchMeter
from tasks.storage.base.keys import chunk_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.authenticator import BatchAuthenticator
from tasks.storage.jobs.records import advance, submit
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


class Ended:
    """A task run whose worker has answered, or died."""

    def __init__(self, answer: EpisodesDone | None) -> None:
        self._answer = answer

    def result(self) -> EpisodesDone:
        if self._answer is None:
            raise RuntimeError("the worker died")
        return self._answer


class TwoWorkers:
    """Two workers in place of a cluster, of which the first dies over its first piece; keeps what they were handed."""

    def __init__(self, batch: OpenBatch) -> None:
        self.handed: list[list[int]] = []
        self.batch = batch

    def with_options(self, **_named: str) -> "TwoWorkers":
        return self

    def submit(
        self, _store: str, batch: str, pieces: list[tuple[EpisodeRequest, ...]], *, engine: str, authenticator: object
    ) -> Ended:
        assert (batch, engine, authenticator) == (self.batch.id, "planar", self.batch.authenticator)
        self.handed.append([len(piece) for piece in pieces])
        if len(self.handed) == 1:
            return Ended(None)
        return Ended(EpisodesDone([[passed(each.seed) for each in piece] for piece in pieces], 0.1))


def test_a_steps_episodes_come_back_in_their_order_though_a_worker_dies(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
):
    batch = begun(file_store)
    workers = TwoWorkers(batch)
    monkeypatch.setattr(spread_work, "simulate_episodes", workers)
    requests = [batch.layout.request(0).model_copy(update={"seed": seed}) for seed in range(600)]
    rows = spread_work._driven_on_workers(batch, "", lambda: 2, requests, "planar")
    assert [row.index for row in rows] == [*range(600)]
    assert sorted(size for piece in workers.handed for size in piece) == [88, 256, 256, 256]


def test_a_step_of_a_canceled_run_is_driven_no_further(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    batch = begun(file_store)
    workers = TwoWorkers(batch)
    monkeypatch.setattr(spread_work, "simulate_episodes", workers)
    run = submit(file_store, "pipeline-run", {"flow": "pipeline"}, "run")
    advance(file_store, "pipeline-run", run.id, "Canceling")
    with pytest.raises(StageFailed, match="canceled on request"):
        spread_work._driven_on_workers(batch, run.id, lambda: 2, [batch.layout.request(0)], "planar")
    assert not workers.handed


def test_a_worker_drives_the_episodes_that_it_is_handed(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    batch = begun(file_store)
    monkeypatch.setattr(
        spread_work, "drive_episodes", lambda _batch, piece, _engine, _folders: [passed(each.seed) for each in piece]
    )
    monkeypatch.setattr(spread_work, "unpacked", lambda _store, digests: {each: Path(each) for each in digests})
    requests = [batch.layout.request(0).model_copy(update={"seed": seed}) for seed in range(3)]
    pieces = [(*requests[:2],), (requests[2],)]
    done = spread_work.simulate_episodes.fn(
        batch.store.url, batch.id, pieces, engine="planar", authenticator=batch.authenticator
    )
    assert [[row.index for row in rows] for rows in done.rows] == [[0, 1], [2]]
