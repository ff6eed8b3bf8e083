"""Jobs that wait for a worker: nobody else takes them for abandoned."""

import pytest

from flows.resources.abandoned_jobs import job_notes, kind_notes, reap_jobs
from specs.errors import ConcurrentDeployment
from tasks.applications.registry import resolve
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.deploy.fleet.reservation import reserve_fleet
from tasks.deploy.rollout.job import run_deployment_job
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import leave_queue
from tasks.storage.jobs.records import advance, read
from tests.flows.queue.queued_jobs import deployment_request, queue_generation, queue_job


def test_a_queued_job_is_no_abandoned_one(file_store: Store):
    job = queue_generation(file_store, "one")

    assert not [*kind_notes(file_store, "world-generation-jobs")]
    assert not [*job_notes(file_store, job.arn)]
    assert reap_jobs(file_store) == []


def test_a_job_that_has_left_the_queue_and_not_ended_is_one(file_store: Store):
    job = queue_generation(file_store, "one")
    leave_queue(file_store, job.kind, job.id)

    assert [*job_notes(file_store, job.arn)]


def test_a_queued_job_that_is_being_canceled_ends_by_reap_where_no_worker_is(file_store: Store):
    job = queue_generation(file_store, "one")
    advance(file_store, job.kind, job.id, "Canceling")

    assert [each.status for each in reap_jobs(file_store)] == ["Canceled"]


def test_the_next_controller_leaves_a_queued_deployment_its_fleet(file_store: Store):
    create_fleet(file_store, "couriers")
    create_robot(file_store, "r1", "X86_64", {})
    register_robot(file_store, "couriers", "r1")
    request = deployment_request(file_store, "couriers", "queued").model_dump(mode="json", exclude_none=True)
    job = queue_job(file_store, "deployment-job", request, "queued")
    reserve_fleet(file_store, "couriers", job.id)
    other = deployment_request(file_store, "couriers", "other")

    digest, token = resolve(file_store, "robot-application", "courier").digest, "other"

    with pytest.raises(ConcurrentDeployment):
        run_deployment_job(file_store, other, digest=digest, token=token, progress=lambda _done, _total: None)

    assert read(file_store, job.kind, job.id).status == "Pending"
