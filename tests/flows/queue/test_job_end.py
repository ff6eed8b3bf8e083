from collections.abc import Mapping
from typing import get_args

import pytest

from flows.queue.attempts import CODES, fail_job
from specs.base import Fault
from specs.errors import DocumentError, ResourceNotFound
from specs.job_kinds import JobKind
from specs.robomaker.failure_codes import (
    DeploymentJobErrorCode,
    WorldExportJobErrorCode,
    WorldGenerationJobErrorCode,
)
from specs.robomaker.simulation import SimulationJobBatchErrorCode
from tasks.applications.registry import publish_bundle
from tasks.export.job.export_answers import describe_export_job
from tasks.simulate.batch.batch_jobs import describe_batch
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import advance
from tasks.worlds.job.world_answers import describe_generation_job
from tests.flows.queue.queued_jobs import queue_batch, queue_export, queue_generation, queue_job, some_worlds
from tests.repository import ROOT

ROBOMAKERS: Mapping[JobKind, object] = {
    "world-generation-job": WorldGenerationJobErrorCode,
    "world-export-job": WorldExportJobErrorCode,
    "simulation-job-batch": SimulationJobBatchErrorCode,
    "deployment-job": DeploymentJobErrorCode,
}


@pytest.mark.parametrize("kind", ROBOMAKERS)
def test_every_code_is_one_that_robomaker_has_for_the_kind(kind: JobKind):
    assert set(CODES[kind]) <= set(get_args(ROBOMAKERS[kind]))


def test_a_generation_that_failed_before_it_began_can_be_described(file_store: Store):
    ended = fail_job(file_store, queue_generation(file_store, "bad"), DocumentError([]))

    assert describe_generation_job(ended).failureCode == "InvalidInput"


def test_an_export_that_failed_can_be_described(file_store: Store):
    ended = fail_job(file_store, queue_export(file_store, ["wgj-1/world-1"], "bad"), "it killed its worker")

    described = describe_export_job(ended)
    assert (described.failureCode, described.failureReason) == ("InternalServiceError", "it killed its worker")


def test_a_deployment_that_failed_says_what_is_missing(file_store: Store):
    job = queue_job(file_store, "deployment-job", {"fleet": "couriers"}, "bad")
    missing = ResourceNotFound([Fault(path="fleet", value="'couriers'", allowed="a fleet")])

    ended = fail_job(file_store, job, missing)

    assert (ended.status, ended.failure_code) == ("Failed", "ResourceNotFound")


def test_the_jobs_of_a_batch_that_failed_before_it_began_say_why(file_store: Store):
    publish_bundle(file_store, "robot-application", "courier", ROOT / "applications/courier")
    publish_bundle(file_store, "simulation-application", "delivery", ROOT / "applications/delivery")
    ended = fail_job(file_store, queue_batch(file_store, some_worlds(file_store), "bad"), DocumentError([]))

    described = describe_batch(file_store, ended.id)

    assert described.failureCode == "InternalServiceError"
    assert {each.failureCode for each in described.failedRequests or ()} == {"InvalidInput"}


def test_a_job_that_is_being_canceled_is_canceled(file_store: Store):
    job = queue_generation(file_store, "stopped")
    advance(file_store, job.kind, job.id, "Canceling")

    assert fail_job(file_store, job, "it killed its worker").status == "Canceled"
