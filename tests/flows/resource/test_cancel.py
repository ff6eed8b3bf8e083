"""A run of a document is cancelled with the job that is under way."""

import pytest
from pydantic import JsonValue

from flows.resources.kinds import cancel_jobs, cancel_resource, cancel_run, require_not_canceled
from specs.errors import DocumentError, ResourceNotFound, StageFailed
from specs.job_kinds import JobKind
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.jobs.records import JobRecord, advance, read, submit
from tasks.storage.jobs.runs import KIND, begin_run, jobs_of, run_of, stage_token

SPEC: dict[str, JsonValue] = {"name": "nightly", "worldGeneration": {}, "worldExport": {"clientRequestToken": "own"}}


def begun_run(store: Store) -> JobRecord:
    with begin_run(store, {"flow": "pipeline", "spec": SPEC}) as run:
        return advance(store, KIND, run.id, "Running")


def job(store: Store, kind: JobKind, token: str, status: str) -> JobRecord:
    return advance(store, kind, submit(store, kind, {}, token).id, status)


def test_a_run_that_nobody_works_on_is_canceled_at_once_with_its_job_and_keeps_what_was_made(file_store: Store) -> None:
    run = begun_run(file_store)
    made = job(file_store, "world-generation-job", stage_token(run, "worlds"), "Completed")
    writing = job(file_store, "world-export-job", "own", "Running")
    cancel_resource(file_store, run.arn)
    assert read(file_store, KIND, run.id).status == "Canceled"
    assert read(file_store, "world-generation-job", made.id).status == "Completed"
    assert read(file_store, "world-export-job", writing.id).status == "Canceled"


def test_whoever_works_on_a_run_is_left_to_end_it(file_store: Store) -> None:
    run = begun_run(file_store)
    with hold_claim(file_store, claim_key(KIND, run.id), ttl_s=3.0):
        assert cancel_run(file_store, run.id).status == "Canceling"
        with pytest.raises(StageFailed, match="Canceled: canceled on request"):
            require_not_canceled(file_store, run)
    assert read(file_store, KIND, run.id).status == "Canceling"
    assert cancel_run(file_store, run.id).status == "Canceled"


def test_a_job_is_cancelled_once(file_store: Store) -> None:
    run = begun_run(file_store)
    writing = job(file_store, "world-export-job", "own", "Running")
    assert cancel_jobs(file_store, run, {writing.id}) == frozenset()
    assert read(file_store, "world-export-job", writing.id).status == "Running"


def test_a_run_that_has_ended_is_not_canceled(file_store: Store) -> None:
    run = begun_run(file_store)
    advance(file_store, KIND, run.id, "Completed")
    with pytest.raises(DocumentError, match="this one is Completed"):
        cancel_resource(file_store, run.arn)


def test_a_run_that_does_not_exist_is_not_found(file_store: Store) -> None:
    with pytest.raises(ResourceNotFound):
        cancel_resource(file_store, "arn:simyard:pipeline-run:0:run-0")


def test_a_canceled_run_is_followed_by_the_next_one(file_store: Store) -> None:
    run = begun_run(file_store)
    cancel_resource(file_store, run.arn)
    assert begun_run(file_store).id != run.id


@pytest.mark.parametrize(
    ("flow", "kind"),
    [
        ("world-generation", "world-generation-job"),
        ("world-export", "world-export-job"),
        ("simulation-batch", "simulation-job-batch"),
        ("deployment-sync", "deployment-job"),
    ],
)
def test_the_job_of_a_stage_that_runs_alone_is_its_runs(file_store: Store, flow: str, kind: JobKind) -> None:
    with begin_run(file_store, {"flow": flow, "spec": {}}) as run:
        token = stage_token(run, flow)
        assert list(jobs_of(run)) == [(kind, submit(file_store, kind, {}, token).id)]
        assert run_of(token) == run.id
    assert run_of("own") == ""
