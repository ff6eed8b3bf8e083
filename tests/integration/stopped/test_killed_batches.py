"""`kill -9` of whoever works on a batch, at random moments: the next one goes on, and the bytes are the same."""

import signal
import time
from pathlib import Path

import numpy as np
import pytest

from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_store import chunk_start
from tests.integration.stopped.worked_batches import CHUNKS, files, opened_at, worker
from tests.servers.eventually import eventually

pytestmark = pytest.mark.integration
KILLS = 3


@pytest.mark.soak
def test_a_batch_killed_at_random_moments_ends_with_the_same_bytes(tmp_path: Path):
    whole, broken = opened_at((tmp_path / "whole").as_uri()), opened_at((tmp_path / "broken").as_uri())
    assert whole.layout.chunks == CHUNKS
    assert worker(whole).wait() == 0
    rng = np.random.default_rng(0)
    folder = tmp_path / "broken/chunks" / broken.id
    for kill in range(KILLS):
        process = worker(broken)
        begun_chunk = folder / f"{kill * CHUNKS // KILLS:06d}.started.json"
        assert eventually(begun_chunk.exists)
        time.sleep(rng.uniform(0.0, 0.1))
        process.send_signal(signal.SIGKILL)
        process.wait()
    _killed_while_tables_are_written(broken)
    assert worker(broken).wait() == 0
    assert files(broken) == files(whole)
    starts = [chunk_start(broken.store, broken.id, number) for number in range(CHUNKS)]
    assert sum(start.attempts for start in starts if start) > CHUNKS  # some were killed before they were committed


def _killed_while_tables_are_written(batch: OpenBatch) -> None:
    process = worker(batch)
    assert eventually(lambda: batch.record().status != "InProgress")
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert batch.record().status in {"Completing", "Completed"}
