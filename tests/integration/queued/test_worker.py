"""A gateway's worker: every kind of job, roll-outs beside batches, and a cancellation that reaches what runs."""

from pathlib import Path

import pytest

from specs.base import canonical_document
from tasks.deploy.fleet.reservation import reserve_fleet
from tasks.deploy.kit.local_agents import local_agents
from tasks.simulate.batch.batch_jobs import cancel_batch
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import queued_jobs
from tasks.storage.jobs.records import JobRecord, is_terminal, read
from tests.flows.queue.queued_jobs import (
    deployment_request,
    queue_batch,
    queue_export,
    queue_generation,
    queue_job,
    some_worlds,
)
from tests.integration.queued.queue_process import wait_until_done, workers_at
from tests.servers.eventually import eventually

pytestmark = [pytest.mark.integration, pytest.mark.usefixtures("prefect_server")]


def _queue_deployment(store: Store, token: str, *, sync: bool = False) -> JobRecord:
    request = canonical_document(deployment_request(store, "couriers", token))
    job = queue_job(store, "deployment-job", request, token, {"sync": True} if sync else {})
    reserve_fleet(store, "couriers", job.id)
    return job


def test_roll_outs_and_worlds_do_not_wait_for_a_batch_which_is_canceled_within_seconds(
    file_store: Store, tmp_path: Path
):
    worlds = some_worlds(file_store)
    with (
        local_agents(file_store, "couriers", 1, tmp_path / "agents"),
        workers_at(file_store, tmp_path),
    ):
        batch = queue_batch(file_store, worlds, "long", seeds=400, lanes=1)
        eventually(lambda: read(file_store, batch.kind, batch.id).status == "InProgress")
        others = [
            queue_generation(file_store, "worlds-beside"),
            queue_export(file_store, worlds, "export-beside"),
            _queue_deployment(file_store, "deployment-beside"),
        ]
        eventually(lambda: all(is_terminal(read(file_store, each.kind, each.id)) for each in others))
        beside = [read(file_store, each.kind, each.id).status for each in others]
        sync = _queue_deployment(file_store, "sync-beside", sync=True)
        eventually(lambda: is_terminal(read(file_store, sync.kind, sync.id)))
        during = read(file_store, batch.kind, batch.id).status
        cancel_batch(file_store, batch.id)
        wait_until_done(file_store)

    assert beside == ["Completed", "Completed", "Succeeded"]
    assert read(file_store, sync.kind, sync.id).status == "Succeeded"
    assert during == "InProgress"
    assert read(file_store, batch.kind, batch.id).status == "Canceled"
    assert queued_jobs(file_store) == []
