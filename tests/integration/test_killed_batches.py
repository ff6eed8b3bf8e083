"""`kill -9` of whoever works on a batch, at random moments: the next one goes on, and the bytes are the same."""

import hashlib
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tasks.simulate.batch import OpenBatch
from tasks.simulate.batch_plan import BatchPlan, JobTemplate
from tasks.simulate.chunk_store import chunk_start
from tasks.storage.keys import world_key
from tasks.storage.opening import open_store
from tests.eventually import eventually
from tests.integration.runs import ROOT, recordings
from tests.simulate.batch_factory import begun
from tests.simulate_factory import ENDLESS, PUSHER, pen

pytestmark = [pytest.mark.integration, pytest.mark.timeout(200)]
CHUNKS = 12
KILLS = 3


def small_plan() -> BatchPlan:
    entry = JobTemplate(
        robot=PUSHER,
        scenario=ENDLESS,
        environment={"FAULT": "0"},
        duration_s=20.0,
        failure_behavior="Fail",
        record=True,
    )
    return BatchPlan(
        templates=(entry, entry.model_copy(update={"environment": {"FAULT": "1"}})),
        worlds=("g/pen-0", "g/pen-1", "g/pen-2"),
        seeds=tuple(range(16)),
        sweep={},
        lanes=8,
        timeout_s=100.0,
        world_digests={},
        engine="planar",
    )


def opened_in(folder: Path) -> OpenBatch:
    """Returns a batch whose worlds lie in a store of its own."""
    store = open_store(folder.as_uri())
    digests: dict[str, str] = {}
    for number in range(3):
        body = pen(4.5, number).model_dump_json().encode()
        store.put(world_key("g", f"pen-{number}"), body)
        digests[f"g/pen-{number}"] = hashlib.sha256(body).hexdigest()
    return begun(store, small_plan().model_copy(update={"world_digests": digests}))


def worker(batch: OpenBatch) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-m", "tests.integration.batch_worker", batch.store.url, batch.id]
    return subprocess.Popen(command, cwd=ROOT)


def files(batch: OpenBatch) -> dict[str, bytes]:
    """Returns the tables, the recordings and all rows of a batch that has ended."""
    record = batch.record()
    assert record.status == "Completed"
    keys = [str(record.detail[name]).removeprefix(batch.store.url + "/") for name in ("results_url", "failures_url")]
    rows = [f"chunks/{batch.id}/{number:06d}.json" for number in range(CHUNKS)]
    return {key: batch.store.get(key).body for key in [*keys, *rows]} | recordings(batch.store)


def test_a_batch_killed_at_random_moments_ends_with_the_same_bytes(tmp_path: Path):
    whole, broken = opened_in(tmp_path / "whole"), opened_in(tmp_path / "broken")
    assert whole.layout.chunks == CHUNKS
    assert worker(whole).wait() == 0
    rng = np.random.default_rng(0)
    folder = tmp_path / "broken/chunks" / broken.id
    for kill in range(KILLS):
        process = worker(broken)
        begun_chunk = folder / f"{kill * CHUNKS // KILLS:06d}.started.json"
        assert eventually(begun_chunk.exists, timeout_s=60.0)
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
    assert eventually(lambda: batch.record().status != "InProgress", timeout_s=60.0)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert batch.record().status in {"Completing", "Completed"}
