"""kill -9 of the worker and of the gateway during batches: nothing is lost, nothing is doubled."""

import logging
import random
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from specs.data.episode import EpisodeResult
from tasks.simulate.batch.batch_record import load_batch
from tasks.simulate.batch.chunk_store import committed_chunk
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import queued_jobs
from tasks.storage.jobs.records import JobRecord, read, records
from tests.flows.queue.queued_jobs import queue_batch, some_worlds
from tests.integration.queued.queue_process import QueueProcess, kill_lane, lane_pids, wait_until_done, workers_at

VICTIMS = ("worker", "gateway")
_LOG = logging.getLogger(__name__)


def _queued(store: Store, worlds: Sequence[str], name: str, seeds: int) -> JobRecord:
    return queue_batch(store, worlds, name, seeds=seeds, lanes=1)


def _rows(store: Store, batch: JobRecord) -> list[Sequence[EpisodeResult] | None]:
    chunks = load_batch(store, batch.id).layout.chunks
    return [committed_chunk(store, batch.id, number) for number in range(chunks)]


def _wait_for_attempt(store: Store) -> None:
    began_s = time.time()
    while not any(entry.begun_s > began_s for entry in queued_jobs(store)):
        time.sleep(0.02)


def _kill(store: Store, workers: QueueProcess, victim: str, rng: random.Random) -> None:
    """Kills the worker, or the gateway, some time after it has begun with a batch, or while it becomes warm."""
    while not lane_pids(store, "simulation"):
        time.sleep(0.05)
    if rng.random() < 0.7:
        _wait_for_attempt(store)
    time.sleep(rng.uniform(0.0, 6.0))
    while not (workers.kill() if victim == "gateway" else kill_lane(store, "simulation")):
        time.sleep(0.05)


def _survives(store: Store, folder: Path, victim: str, kills: int, seeds: int) -> None:
    worlds, rng = some_worlds(store), random.Random(kills)  # noqa: S311 - no secret
    broken = list[JobRecord]()
    with workers_at(store, folder) as workers:
        unbroken = _queued(store, worlds, "unbroken", seeds)
        wait_until_done(store)
        for number in range(kills):
            while len(queued_jobs(store)) < min(2, kills):
                broken.append(_queued(store, worlds, f"broken-{len(broken)}", seeds))
            _kill(store, workers, victim, rng)
            _LOG.warning("%s: kill %d of the %s, batch %d", store.url, number + 1, victim, len(broken))
        wait_until_done(store)

    expected = _rows(store, unbroken)
    assert None not in expected
    assert [_rows(store, each) for each in broken] == [expected] * len(broken)
    assert {read(store, each.kind, each.id).status for each in broken} == {"Completed"}
    assert len(records(store, "simulation-job-batch")) == len(broken) + 1


@pytest.mark.integration
@pytest.mark.usefixtures("prefect_server")
def test_a_batch_whose_worker_is_killed_has_the_results_of_an_unbroken_one(file_store: Store, tmp_path: Path):
    _survives(file_store, tmp_path, "worker", kills=1, seeds=4)


@pytest.mark.integration
@pytest.mark.soak
@pytest.mark.timeout(3000)
@pytest.mark.parametrize("victim", VICTIMS)
def test_twenty_kills_lose_and_double_nothing(
    store: Store, tmp_path: Path, victim: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "prefect"))
    _survives(store, tmp_path, victim, kills=20, seeds=24)
