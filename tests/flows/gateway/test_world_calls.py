"""World templates, worlds, and the jobs that generate and export them."""

import json
from collections.abc import Callable
from typing import Any, cast

import pytest
from pydantic import JsonValue

from specs.base import canonical_document, canonical_json
from specs.errors import (
    DocumentError,
    IdempotentParameterMismatch,
    LimitExceeded,
    ResourceAlreadyExists,
    ResourceNotFound,
)
from specs.job_kinds import JobKind
from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody
from tasks.storage.base.keys import tags_key, world_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.queue import is_queued, leave_queue
from tasks.storage.jobs.records import JobRecord, advance, read, submit
from tasks.storage.jobs.runs import jobs_of
from tasks.storage.templates import keep_body, read_body
from tasks.worlds.job.stored_worlds import delete_worlds
from tasks.worlds.job.world_answers import list_worlds
from tasks.worlds.step import generate_worlds
from tests.factories.gateway.old_records import fail_with_code
from tests.factories.worlds import apartment
from tests.flows.gateway.asked import ROLE, Asked, path
from tests.worlds.templates import SAMPLES

SMALL, WIDE = (path.read_text() for path in SAMPLES[:2])
TEMPLATE = f"arn:simyard:world-template:s:{'0' * 64}"
COUNT: JsonValue = {"floorplanCount": 1}
GENERATION: JobKind = "world-generation-job"
EXPORT: JobKind = "world-export-job"
BOTH = pytest.mark.parametrize("kind", [GENERATION, EXPORT])


def create(gateway: Asked, **more: Any) -> dict[str, Any]:  # noqa: ANN401 - RoboMaker's
    return gateway.call("CreateWorldTemplate", **{"templateBody": SMALL, **more})


def body_of(gateway: Asked, template: str) -> TemplateBody:
    text = gateway.call("GetWorldTemplateBody", template=template)["templateBody"]
    return TemplateBody.model_validate(json.loads(text))


def test_a_template_is_described_as_it_was_asked_for(gateway: Asked) -> None:
    made = create(gateway, name="a small flat", tags={"team": "arms"}, clientRequestToken="t")
    described = gateway.call("DescribeWorldTemplate", template=made["arn"])
    assert {name: described[name] for name in made} == made
    assert described["lastUpdatedAt"] == described["createdAt"]
    assert (described["name"], described["tags"], described["version"]) == ("a small flat", {"team": "arms"}, "1")
    assert body_of(gateway, made["arn"]) == TemplateBody.model_validate(SMALL)


def test_a_body_may_lie_in_a_bucket(gateway: Asked) -> None:
    open_bucket(gateway.store, "shapes").put("flat.json", SMALL.encode())
    place = {"s3Bucket": "shapes", "s3Key": "flat.json"}
    made = gateway.call("CreateWorldTemplate", templateLocation=place)
    assert body_of(gateway, made["arn"]) == TemplateBody.model_validate(SMALL)
    with pytest.raises(ResourceNotFound, match="none is there"):
        gateway.call("CreateWorldTemplate", templateLocation={**place, "s3Key": "other.json"})
    open_bucket(gateway.store, "shapes").put("big.json", b" " * (1 << 21))
    with pytest.raises(DocumentError, match="templateLocation"):
        gateway.call("CreateWorldTemplate", templateLocation={**place, "s3Key": "big.json"})


@pytest.mark.parametrize(
    "members", [{}, {"templateBody": SMALL, "templateLocation": {"s3Bucket": "abc", "s3Key": "k"}}]
)
def test_a_body_is_given_once(gateway: Asked, members: dict[str, Any]) -> None:
    with pytest.raises(DocumentError, match=r"templateBody|templateLocation"):
        gateway.call("CreateWorldTemplate", **members)


def test_an_update_changes_body_or_name_and_keeps_the_arn(gateway: Asked) -> None:
    made = create(gateway, name="flat")
    changed = gateway.call("UpdateWorldTemplate", template=made["arn"], templateBody=WIDE)
    assert (changed["arn"], changed["name"]) == (made["arn"], "flat")
    assert changed["lastUpdatedAt"] > changed["createdAt"]
    assert body_of(gateway, made["arn"]) == TemplateBody.model_validate(WIDE)
    assert gateway.call("UpdateWorldTemplate", template=made["arn"], name="house")["name"] == "house"
    with pytest.raises(DocumentError, match="nothing to change"):
        gateway.call("UpdateWorldTemplate", template=made["arn"])


def test_a_job_has_the_body_that_it_began_with(gateway: Asked) -> None:
    made = create(gateway)
    job = gateway.call("CreateWorldGenerationJob", template=made["arn"], worldCount={"floorplanCount": 1})["arn"]
    gateway.call("UpdateWorldTemplate", template=made["arn"], templateBody=WIDE)
    text = gateway.call("GetWorldTemplateBody", generationJob=job)["templateBody"]
    assert TemplateBody.model_validate(json.loads(text)) == TemplateBody.model_validate(SMALL)
    gateway.call("DeleteWorldTemplate", template=made["arn"])
    assert gateway.call("GetWorldTemplateBody", generationJob=job)["templateBody"] == text


def test_a_body_is_asked_of_a_template_or_of_a_job(gateway: Asked) -> None:
    with pytest.raises(DocumentError, match="template or generationJob"):
        gateway.call("GetWorldTemplateBody")
    template, job = gateway.arn("world-template", "wt-1"), gateway.arn("world-generation-job", "wgj-1")
    with pytest.raises(DocumentError, match="template or generationJob"):
        gateway.call("GetWorldTemplateBody", template=template, generationJob=job)
    for members in ({"template": template}, {"generationJob": job}):
        with pytest.raises(ResourceNotFound):
            gateway.call("GetWorldTemplateBody", **members)


def test_a_token_makes_one_template_also_when_there_is_no_room(gateway: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_MAX_TEMPLATES", "1")
    made = create(gateway, clientRequestToken="t", name="flat")
    assert create(gateway, clientRequestToken="t", name="flat") == made
    with pytest.raises(IdempotentParameterMismatch):
        create(gateway, clientRequestToken="t", name="house")
    with pytest.raises(ResourceAlreadyExists):
        create(gateway, name="flat")
    with pytest.raises(LimitExceeded, match="SIMYARD_MAX_TEMPLATES"):
        create(gateway)


def test_a_deleted_template_is_gone(gateway: Asked) -> None:
    template = create(gateway)["arn"]
    assert gateway.call("DeleteWorldTemplate", template=template) == {}
    for call in ("DescribeWorldTemplate", "GetWorldTemplateBody", "DeleteWorldTemplate", "UpdateWorldTemplate"):
        with pytest.raises(ResourceNotFound):
            gateway.call(call, template=template)


def test_a_body_that_documents_used_is_read_and_never_changed(gateway: Asked) -> None:
    digest = keep_body(gateway.store, TemplateBody.model_validate(SMALL))
    template = gateway.arn("world-template", digest)
    assert gateway.call("DescribeWorldTemplate", template=template)["name"] == digest
    assert body_of(gateway, template) == TemplateBody.model_validate(SMALL)
    for call in ("DeleteWorldTemplate", "UpdateWorldTemplate"):
        with pytest.raises(ResourceNotFound, match="CreateWorldTemplate"):
            gateway.call(call, template=template)


def generation(store: Store, *names: str, status: str = "Completed", tags: JsonValue = None) -> JobRecord:
    """Returns a generation job that made worlds of these names."""
    request: dict[str, JsonValue] = {"template": TEMPLATE, "worldCount": COUNT, "templateDigest": "0" * 64}
    record = submit(store, "world-generation-job", {**request, **({"worldTags": tags} if tags else {})}, "t")
    for name in names:
        made = apartment(generation=record.id, name=name)
        store.put(world_key(record.id, name), canonical_json(canonical_document(made)))
    worlds = cast("JsonValue", [f"{record.id}/{name}" for name in names])
    return advance(store, "world-generation-job", record.id, status, detail={"worlds": worlds})


def under_way(store: Store, kind: JobKind, request: dict[str, JsonValue]) -> JobRecord:
    """Returns a job that has not ended."""
    return submit(store, kind, request, "under way")


def test_a_world_has_the_tags_of_its_job_and_those_that_came_later(gateway: Asked) -> None:
    job = generation(gateway.store, "w", tags={"floor": "oak"})
    world = gateway.arn("world", f"{job.id}/w")
    assert gateway.call("DescribeWorld", world=world)["tags"] == {"floor": "oak"}
    gateway.call("TagResource", resourceArn=world, tags={"kitchen": "small"})
    described = gateway.call("DescribeWorld", world=world)
    assert described["tags"] == {"floor": "oak", "kitchen": "small"}
    assert (described["generationJob"], described["template"]) == (job.arn, TEMPLATE)


def test_deleted_worlds_are_gone_with_their_tags(gateway: Asked) -> None:
    job = generation(gateway.store, "a", "b")
    first, second = (gateway.arn("world", f"{job.id}/{name}") for name in "ab")
    gateway.call("TagResource", resourceArn=first, tags={"kitchen": "small"})
    assert gateway.call("BatchDeleteWorlds", worlds=[first, first]) == {}
    with pytest.raises(ResourceNotFound):
        gateway.call("DescribeWorld", world=first)
    assert not gateway.store.exists(tags_key("world", f"{job.id}/a"))
    assert [each.arn for each in list_worlds(gateway.store)] == [second]


def test_what_its_job_says_of_a_deleted_world_stays(gateway: Asked) -> None:
    job = generation(gateway.store, "a")
    world = gateway.arn("world", f"{job.id}/a")
    gateway.call("BatchDeleteWorlds", worlds=[world])
    summary = gateway.call("DescribeWorldGenerationJob", job=job.arn)["finishedWorldsSummary"]
    assert summary["succeededWorlds"] == [world]


def test_what_is_no_world_that_is_there_is_left_over(gateway: Asked) -> None:
    job = generation(gateway.store, "a")
    good = gateway.arn("world", f"{job.id}/a")
    bad = [gateway.arn("world", f"{job.id}/b"), gateway.arn("world", "one part"), job.arn, "arn:nothing"]
    left = gateway.call("BatchDeleteWorlds", worlds=[bad[0], good, *bad[1:]])["unprocessedWorlds"]
    assert sorted(left) == sorted(bad)
    assert not gateway.store.exists(world_key(job.id, "a"))


@pytest.mark.parametrize("kind", ["simulation-job-batch", "world-export-job"])
def test_a_world_that_a_job_under_way_needs_stays(gateway: Asked, kind: JobKind) -> None:
    store = gateway.store
    job = generation(store, "a", "b")
    world, reference = gateway.arn("world", f"{job.id}/a"), f"{job.id}/a"
    plan: JsonValue = {"world_digests": {reference: "0" * 64}}
    user = under_way(store, kind, {"plan": plan} if kind == "simulation-job-batch" else {"worlds": [world]})
    other = gateway.arn("world", f"{job.id}/b")
    assert gateway.call("BatchDeleteWorlds", worlds=[world, other]) == {"unprocessedWorlds": [world]}
    advance(store, kind, user.id, "Failed")
    assert gateway.call("BatchDeleteWorlds", worlds=[world]) == {}


def test_a_world_whose_own_job_is_under_way_stays(gateway: Asked) -> None:
    job = generation(gateway.store, "a", status="Running")
    world = gateway.arn("world", f"{job.id}/a")
    assert gateway.call("BatchDeleteWorlds", worlds=[world]) == {"unprocessedWorlds": [world]}


def test_a_world_that_a_job_names_at_that_very_moment_is_put_back(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = generation(file_store, "a")
    delete = file_store.delete
    body = file_store.get(world_key(job.id, "a")).body

    def begin_then_delete(key: str) -> None:
        monkeypatch.undo()
        under_way(file_store, "world-export-job", {"worlds": [f"{job.id}/a"]})
        delete(key)

    monkeypatch.setattr(file_store, "delete", begin_then_delete)
    assert delete_worlds(file_store, [f"{job.id}/a"]) == [f"{job.id}/a"]
    assert file_store.get(world_key(job.id, "a")).body == body


def test_a_world_of_a_document_that_is_run_stays_until_the_run_has_ended(file_store: Store) -> None:
    request: dict[str, JsonValue] = {"flow": "pipeline", "spec": {"name": "night", "worldGeneration": {}}}
    run = submit(file_store, "pipeline-run", request, "run-token")
    ((_, made),) = jobs_of(run)
    file_store.put(world_key(made, "w"), b"world")
    assert delete_worlds(file_store, [f"{made}/w"]) == [f"{made}/w"]
    advance(file_store, "pipeline-run", run.id, "Failed")
    assert delete_worlds(file_store, [f"{made}/w"]) == []


def _generation(asked: Asked, **more: Any) -> dict[str, Any]:  # noqa: ANN401 - RoboMaker's requests
    return {"template": asked.template(), "worldCount": {"floorplanCount": 1, "interiorCountPerFloorplan": 2}, **more}


def _export(asked: Asked, **more: Any) -> dict[str, Any]:  # noqa: ANN401 - as above
    place = {"s3Bucket": "exports", "s3Prefix": "home"}
    return {"worlds": [asked.world()], "outputLocation": place, "iamRole": ROLE, **more}


def _asked_for(asked: Asked, kind: JobKind, **more: Any) -> tuple[str, dict[str, Any]]:  # noqa: ANN401 - as above
    make: Callable[..., dict[str, Any]] = _generation if kind == GENERATION else _export
    return "WorldGenerationJob" if kind == GENERATION else "WorldExportJob", make(asked, **more)


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
