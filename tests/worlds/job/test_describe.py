"""Jobs and worlds are described in RoboMaker's words."""

import json
from typing import Any

from pydantic import JsonValue

from specs.data.world import World
from tasks.storage.jobs.records import JobRecord
from tasks.worlds.generate import generate_world
from tasks.worlds.job.world_answers import describe_generation_job, describe_world, summarise_generation_job
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
