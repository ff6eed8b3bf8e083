"""Jobs, worlds and templates are described in RoboMaker's words, one by one and in pages."""

import json
from typing import Any

import pytest
from pydantic import JsonValue

from specs.arn import resource_name
from specs.data.world import World
from specs.errors import DocumentError
from specs.robomaker.world_jobs import ListWorldGenerationJobsRequest, ListWorldsRequest, ListWorldTemplatesRequest
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, submit
from tasks.storage.templates import create_template, keep_body
from tasks.worlds.generate import generate_world
from tasks.worlds.job.world_answers import (
    describe_generation_job,
    describe_world,
    list_generation_jobs_page,
    list_templates_page,
    list_worlds,
    list_worlds_page,
    summarise_generation_job,
)
from tests.factories.worlds import apartment
from tests.worlds.templates import doorway, room, template

JOB = "wgj-0000000000000001"
TEMPLATE = "arn:aws:robomaker:us-west-2:111111111111:world-template/my-template"
FAILED: dict[str, JsonValue] = {"InvalidInput": {"count": 2, "sample_reason": "make a room larger"}}


def record(status: str, worlds: list[JsonValue], failures: dict[str, JsonValue], **fields: str) -> JobRecord:
    return JobRecord(
        kind="world-generation-job",
        id=JOB,
        arn=f"arn:simyard:world-generation-job:feed:{JOB}",
        token="t",  # noqa: S106 - a request token is no secret
        request_digest="0",
        request={
            "template": TEMPLATE,
            "worldCount": {"floorplanCount": 3, "interiorCountPerFloorplan": 1},
            "worldTags": {"kind": "test"},
            "seed": 7,
            "templateDigest": "0",
        },
        status=status,
        failure_code=fields.get("code", ""),
        failure_reason=fields.get("reason", ""),
        created_at_s=12.5,
        updated_at_s=13.0,
        detail={"worlds": worlds, "failures": failures},
    )


def plain(response: Any) -> dict[str, Any]:  # noqa: ANN401 - any response
    return response.model_dump(mode="json", exclude_none=True)


def test_a_completed_job_names_its_worlds() -> None:
    found = plain(describe_generation_job(record("Completed", [f"{JOB}/world-1-1"], {})))
    assert found["status"] == "Completed"
    assert found["clientRequestToken"] == "t"
    assert found["worldCount"] == {"floorplanCount": 3, "interiorCountPerFloorplan": 1}
    assert found["worldTags"] == {"kind": "test"}
    summary = found["finishedWorldsSummary"]
    assert summary == {"finishedCount": 1, "succeededWorlds": [f"arn:simyard:world:feed:{JOB}/world-1-1"]}
    assert "failureCode" not in found


def test_finished_worlds_are_those_that_succeeded_and_those_that_failed() -> None:
    found = plain(describe_generation_job(record("PartialFailed", [f"{JOB}/world-1-1"], FAILED)))
    summary = found["finishedWorldsSummary"]
    assert summary["finishedCount"] == 3
    assert summary["failureSummary"]["totalFailureCount"] == 2
    assert summary["failureSummary"]["failures"] == [
        {"failureCode": "InvalidInput", "sampleFailureReason": "make a room larger", "failureCount": 2}
    ]


def test_a_job_of_more_worlds_than_robomakers_lists_had_names_all_of_them() -> None:
    made: list[JsonValue] = [f"{JOB}/world-{number}-1" for number in range(10_000)]
    found = plain(describe_generation_job(record("Completed", made, {})))
    assert len(found["finishedWorldsSummary"]["succeededWorlds"]) == 10_000


def test_a_failed_job_says_why_and_lists_no_worlds() -> None:
    ended = record("Failed", [], FAILED, code="AllWorldGenerationFailed", reason="make a room larger")
    found = plain(describe_generation_job(ended))
    assert (found["failureCode"], found["failureReason"]) == ("AllWorldGenerationFailed", "make a room larger")
    assert "succeededWorlds" not in found["finishedWorldsSummary"]


def test_a_job_that_has_not_begun_can_be_described() -> None:
    waiting = record("Pending", [], {}).model_copy(update={"detail": {}})
    assert plain(describe_generation_job(waiting))["finishedWorldsSummary"] == {"finishedCount": 0}


def test_a_summary_counts_worlds() -> None:
    found = plain(summarise_generation_job(record("PartialFailed", [f"{JOB}/world-1-1"], FAILED)))
    assert (found["succeededWorldCount"], found["failedWorldCount"]) == (1, 2)


def test_a_world_is_described_with_its_job_and_its_own_tags() -> None:
    world: World = apartment(generation=JOB, name="world-1-1")
    found = plain(describe_world(world, record("Completed", [f"{JOB}/world-1-1"], {}), "feed"))
    assert found == {
        "arn": f"arn:simyard:world:feed:{JOB}/world-1-1",
        "generationJob": f"arn:simyard:world-generation-job:feed:{JOB}",
        "template": TEMPLATE,
        "createdAt": 12.5,
        "tags": {"kind": "test"},
    }


def test_a_world_with_doors_is_described_with_them() -> None:
    body = template(room("A"), room("B"), version="2", doorways=(doorway("Target.All", 25),))
    world = generate_world(body, seed=1, generation=JOB, floorplan_index=1, interior_index=1)
    text = describe_world(world, record("Completed", [f"{JOB}/world-1-1"], {}), "feed").worldDescriptionBody
    assert text is not None
    (door,) = json.loads(text)["doors"]
    assert (door["name"], sorted(door["rooms"]), door["openPercent"]) == ("door_1", ["A", "B"], 25)
    assert door["hinge"] == {"x": world.doors[0].hinge_m[0], "y": world.doors[0].hinge_m[1]}


def generated(store: Store, token: str, worlds: list[str], status: str = "Completed") -> JobRecord:
    """Returns a job that made worlds."""
    template_arn = f"arn:simyard:world-template:0:{token}"
    request: dict[str, JsonValue] = {"template": template_arn, "worldCount": {"floorplanCount": 1}}
    job = submit(store, "world-generation-job", request, token)
    for name in worlds:
        store.put(world_key(job.id, name), b"{}")
    return advance(store, "world-generation-job", job.id, status)


def test_worlds_come_by_job_and_number_and_those_that_somebody_added_last(file_store: Store) -> None:
    old = generated(file_store, "a", ["world-1-10", "world-1-9", "world-2-1"])
    file_store.put(world_key("aardvark", "w"), b"{}")
    new = generated(file_store, "b", ["world-1-1"])
    names = [resource_name(str(world.arn)) for world in list_worlds(file_store)]
    made = [f"{old.id}/world-1-9", f"{old.id}/world-1-10", f"{old.id}/world-2-1", f"{new.id}/world-1-1"]
    assert names == [*made, "aardvark/w"]
    first = list_worlds_page(file_store, ListWorldsRequest(maxResults=2))
    for gone in ("world-1-9", "world-1-10"):
        file_store.delete(world_key(old.id, gone))
    second = list_worlds_page(file_store, ListWorldsRequest(maxResults=100, nextToken=first.nextToken))
    assert [resource_name(str(world.arn)) for world in second.worldSummaries or ()] == [*made[2:], "aardvark/w"]
    assert second.nextToken is None


@pytest.mark.parametrize(
    ("name", "value", "found"), [("status", "Failed", "b"), ("templateId", "a", "a"), ("generationJobId", None, "b")]
)
def test_worlds_are_found_by_their_job(file_store: Store, name: str, value: str | None, found: str) -> None:
    jobs = {"a": generated(file_store, "a", ["w"]), "b": generated(file_store, "b", ["w"], "Failed")}
    asked = {"filters": [{"name": name, "values": [value or jobs[found].id]}]}
    page = list_worlds_page(file_store, ListWorldsRequest.model_validate(asked))
    assert [world.generationJob for world in page.worldSummaries or ()] == [jobs[found].arn]


def test_generation_jobs_are_found_by_status_and_template(file_store: Store) -> None:
    done, failed = generated(file_store, "a", ["w"]), generated(file_store, "b", [], "Failed")
    for name, value, job in (("status", "Completed", done), ("templateId", "b", failed)):
        asked = ListWorldGenerationJobsRequest.model_validate({"filters": [{"name": name, "values": [value]}]})
        page = list_generation_jobs_page(file_store, asked)
        assert [each.arn for each in page.worldGenerationJobSummaries] == [job.arn]


def test_templates_that_somebody_named_come_before_those_of_documents(file_store: Store) -> None:
    named = create_template(file_store, template(room("A")), name="flat")
    digest = keep_body(file_store, template(room("B")))
    first = list_templates_page(file_store, ListWorldTemplatesRequest(maxResults=1))
    second = list_templates_page(file_store, ListWorldTemplatesRequest(maxResults=1, nextToken=first.nextToken))
    shown = [*(first.templateSummaries or ()), *(second.templateSummaries or ())]
    assert [(each.name, resource_name(str(each.arn))) for each in shown] == [("flat", named.id), (digest, digest)]
    assert second.nextToken is None


def test_the_token_of_another_list_is_none(file_store: Store) -> None:
    for number in range(2):
        generated(file_store, str(number), ["w"])
    token = list_worlds_page(file_store, ListWorldsRequest(maxResults=1)).nextToken
    with pytest.raises(DocumentError, match="nextToken"):
        list_generation_jobs_page(file_store, ListWorldGenerationJobsRequest(nextToken=token))
