"""A batch that processes of its own work on, without Prefect, so that a test can break them often in little time."""

import hashlib
import subprocess
import sys

from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.plan.batch_plan import BatchPlan, JobTemplate
from tasks.storage.base.keys import world_key
from tasks.storage.store_url import open_store
from tests.factories.planned_batches import begun
from tests.factories.simulations import ENDLESS, PUSHER, pen
from tests.integration.runs import ROOT, recordings

CHUNKS = 12


def small_plan() -> BatchPlan:
    """Returns a plan of two robots, three worlds and sixteen seeds, in twelve chunks; everything is recorded."""
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


def opened_at(url: str) -> OpenBatch:
    """Returns a batch whose worlds lie in a store of its own."""
    store = open_store(url)
    digests: dict[str, str] = {}
    for number in range(3):
        body = pen(4.5, number).model_dump_json().encode()
        store.put(world_key("g", f"pen-{number}"), body)
        digests[f"g/pen-{number}"] = hashlib.sha256(body).hexdigest()
    return begun(store, small_plan().model_copy(update={"world_digests": digests}))


def worker(batch: OpenBatch) -> "subprocess.Popen[bytes]":
    """Returns a process that works on a batch to its end; what it says, pytest captures."""
    command = [sys.executable, "-m", "tests.integration.stopped.batch_worker", batch.store.url, batch.id]
    return subprocess.Popen(command, cwd=ROOT)


def files(batch: OpenBatch) -> dict[str, bytes]:
    """Returns the tables, the recordings and all rows of a batch that has ended."""
    record = batch.record()
    assert record.status == "Completed"
    keys = [str(record.detail[name]).removeprefix(batch.store.url + "/") for name in ("results_url", "failures_url")]
    rows = [f"chunks/{batch.id}/{number:06d}.json" for number in range(CHUNKS)]
    return {key: batch.store.get(key).body for key in [*keys, *rows]} | recordings(batch.store)
