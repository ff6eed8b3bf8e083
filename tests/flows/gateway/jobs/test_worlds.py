"""World generation and export jobs: asked for, described, cancelled."""

from collections.abc import Callable
from typing import Any, cast

import pytest

from specs.errors import DocumentError, IdempotentParameterMismatch, LimitExceeded, ResourceNotFound
from specs.job_kinds import JobKind
from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody
from tasks.storage.jobs.queue import is_queued, leave_queue
from tasks.storage.jobs.records import advance, read
from tasks.storage.templates import read_body
from tasks.worlds.step import generate_worlds
from tests.factories.gateway.old_records import fail_with_code
from tests.flows.gateway.jobs.asked import ROLE, Asked, path

GENERATION: JobKind = "world-generation-job"
EXPORT: JobKind = "world-export-job"


def _generation(asked: Asked, **more: Any) -> dict[str, Any]:  # noqa: ANN401 - RoboMaker's requests
    return {"template": asked.template(), "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 2}, **more}


def _export(asked: Asked, **more: Any) -> dict[str, Any]:  # noqa: ANN401 - as above
    place = {"s3Bucket": "exports", "s3Prefix": "home"}
    return {"worlds": [asked.world()], "outputLocation": place, "iamRole": ROLE, **more}


def _asked_for(asked: Asked, kind: JobKind, **more: Any) -> tuple[str, dict[str, Any]]:  # noqa: ANN401 - as above
    make: Callable[..., dict[str, Any]] = _generation if kind == GENERATION else _export
    return "WorldGenerationJob" if kind == GENERATION else "WorldExportJob", make(asked, **more)


BOTH = pytest.mark.parametrize("kind", [GENERATION, EXPORT])


@BOTH
def test_a_job_is_recorded_and_queued_and_answers_what_was_asked(kind: JobKind, asked: Asked):
    name, request = _asked_for(asked, kind, tags={"a": "b"})
    made = asked.call(f"Create{name}", **request)
    assert {key: made[key] for key in request if key != "worlds"} == {k: v for k, v in request.items() if k != "worlds"}
    assert made["status"] == "Pending"
    assert is_queued(asked.store, kind, path(made))
    described = asked.call(f"Describe{name}", job=made["arn"])
    assert {key: described[key] for key in request} == request


@BOTH
def test_the_same_call_again_is_the_same_job(kind: JobKind, asked: Asked):
    name, request = _asked_for(asked, kind, clientRequestToken="t")
    made = asked.call(f"Create{name}", **request)
    assert asked.call(f"Create{name}", **request) == made
    with pytest.raises(IdempotentParameterMismatch):
        asked.call(f"Create{name}", **request, tags={"a": "b"})


@BOTH
def test_one_more_than_the_quota_is_refused(kind: JobKind, asked: Asked, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_MAX_GENERATION_JOBS", "1")
    monkeypatch.setenv("SIMYARD_MAX_EXPORT_JOBS", "1")
    name, request = _asked_for(asked, kind)
    asked.call(f"Create{name}", **request)
    with pytest.raises(LimitExceeded):
        asked.call(f"Create{name}", **request)


@BOTH
def test_a_cancelled_job_that_nobody_has_begun_is_canceled_at_once(kind: JobKind, asked: Asked):
    name, request = _asked_for(asked, kind)
    made = asked.call(f"Create{name}", **request)
    for _ in range(2):
        assert asked.call(f"Cancel{name}", job=made["arn"]) == {}
    assert asked.call(f"Describe{name}", job=made["arn"])["status"] == "Canceled"
    assert not is_queued(asked.store, kind, path(made))


@BOTH
def test_a_running_job_is_said_to_be_canceling_and_one_that_has_ended_is_not_cancelled(kind: JobKind, asked: Asked):
    name, request = _asked_for(asked, kind)
    made = asked.call(f"Create{name}", **request)
    advance(asked.store, kind, path(made), "Running")
    leave_queue(asked.store, kind, path(made))  # as a job of a document's run that was killed
    asked.call(f"Cancel{name}", job=made["arn"])
    assert is_queued(asked.store, kind, path(made))  # a worker ends it
    assert asked.call(f"Describe{name}", job=made["arn"])["status"] == "Canceling"
    other = asked.call(f"Create{name}", **request)
    advance(asked.store, kind, path(other), "Completed")
    with pytest.raises(DocumentError, match="Completed"):
        asked.call(f"Cancel{name}", job=other["arn"])


@BOTH
def test_a_job_that_is_not_there_is_not_found(kind: JobKind, asked: Asked):
    name, _ = _asked_for(asked, kind)
    for operation in ("Describe", "Cancel"):
        with pytest.raises(ResourceNotFound):
            asked.call(f"{operation}{name}", job=asked.arn(kind, "none"))


@BOTH
def test_a_failure_code_of_another_kind_is_told_as_an_internal_error(kind: JobKind, asked: Asked):
    name, request = _asked_for(asked, kind)
    made = asked.call(f"Create{name}", **request)
    why = f"{asked.store.url}/jobs is gone"
    fail_with_code(asked.store, kind, path(made), "EtagMismatch", why)
    told = asked.call(f"Describe{name}", job=made["arn"])
    assert told["failureCode"] == "InternalServiceError"
    assert told.get("failureReason", "the store/jobs is gone") == "the store/jobs is gone"


def test_jobs_have_seeds_of_their_own_and_a_token_has_one(asked: Asked):
    request = _generation(asked)
    records = [read(asked.store, GENERATION, path(asked.call("CreateWorldGenerationJob", **request))) for _ in "ab"]
    assert len({cast("int", record.request["seed"]) for record in records}) == 2
    (digest,) = {str(record.request["templateDigest"]) for record in records}
    assert read_body(asked.store, digest)


def test_a_record_is_what_the_stage_of_worlds_submits(asked: Asked):
    """Else the worker's own submission would be another request under the same token."""
    request = _generation(asked, worldCount={"floorplanCount": 0}, clientRequestToken="t")
    record = read(asked.store, GENERATION, path(asked.call("CreateWorldGenerationJob", **request)))
    body = TemplateBody.model_validate_json(read_body(asked.store, str(record.request["templateDigest"])))
    checked = CreateWorldGenerationJobRequest.model_validate(request)
    seed = cast("int", record.request["seed"])
    ended = generate_worlds(asked.store.url, checked, body, seed=seed, token=record.token, robot_radius_m=0.25)
    assert (ended.id, ended.failure_code) == (record.id, "AllWorldGenerationFailed")


def test_a_template_that_is_not_there_is_not_found(asked: Asked):
    with pytest.raises(ResourceNotFound):
        asked.call("CreateWorldGenerationJob", **_generation(asked, template=asked.arn("world-template", "wt-none")))


def test_worlds_that_are_not_there_are_all_named(asked: Asked):
    gone = [asked.arn("world", f"hand/none{number}") for number in range(2)]
    with pytest.raises(ResourceNotFound) as refused:
        asked.call("CreateWorldExportJob", **_export(asked, worlds=gone))
    assert [fault.path for fault in refused.value.faults] == ["worlds[0]", "worlds[1]"]
    with pytest.raises(DocumentError) as wrong:
        asked.call("CreateWorldExportJob", **_export(asked, worlds=[asked.fleet()]))
    assert type(wrong.value) is DocumentError


def test_an_export_without_a_bucket_is_refused(asked: Asked):
    with pytest.raises(DocumentError, match="s3Bucket"):
        asked.call("CreateWorldExportJob", **_export(asked, outputLocation={}))
