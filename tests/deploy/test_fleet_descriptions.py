"""Deployments, fleets and robots in RoboMaker's words: one, in pages, and as rows for a person."""

from dataclasses import replace
from pathlib import Path

import pytest

from specs.errors import DocumentError
from specs.robomaker.deployment import ListDeploymentJobsRequest, ListFleetsRequest, ListRobotsRequest
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.deploy.fleet_descriptions import (
    deployment_sentence,
    describe_deployment_job,
    describe_fleet,
    describe_robot,
    list_deployment_jobs_page,
    list_fleets,
    list_fleets_page,
    list_robots,
    list_robots_page,
    robot_rows,
    view_deployment,
)
from tasks.deploy.trust.trust_record import UNSIGNED_ALARM
from tasks.storage.base.keys import job_key, reported_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard


def test_a_robot_is_available_then_registered_then_in_sync(yard: Yard) -> None:
    create_robot(yard.store, "r0", tags={"site": "hall"})
    assert describe_robot(yard.store, "r0").status == "Available"
    register_robot(yard.store, FLEET, "r0")
    assert describe_robot(yard.store, "r0").status == "Registered"
    version = yard.publish({"run.sh": STAYS_UP})
    record = run(yard, PuppetRobots(yard.store, 1), yard.request(version, "one"), version.digest)

    described = describe_robot(yard.store, "r0")

    assert (described.status, described.lastDeploymentJob, described.tags) == ("InSync", record.arn, {"site": "hall"})
    assert [robot.name for robot in list_robots(yard.store)] == ["r0"]


def test_a_fleet_without_robots_or_deployments_can_be_described(file_store: Store) -> None:
    create_fleet(file_store, "empty", {"site": "hall"})

    described = describe_fleet(file_store, "empty")

    assert (described.name, described.robots, described.lastDeploymentJob) == ("empty", (), None)
    assert [fleet.arn for fleet in list_fleets(file_store)] == [described.arn]


def test_a_deployment_under_way_is_described_as_its_robots_are_now(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 2)
    seen: list[str | None] = []

    def look(ended: int, _all: int) -> None:
        job = yard.store.keys("jobs/deployment-job")[0].split("/")[-1].removesuffix(".json")
        seen.extend(each.status for each in describe_deployment_job(yard.store, job).robotDeploymentSummary or ())

    run(yard, robots, yard.request(version, "one"), version.digest, progress=look)

    assert seen[:2] == ["InSync", "PendingNewDeployment"]
    assert yard.store.exists(reported_key("r1"))


def test_the_progress_of_a_robot_names_the_deployment_that_it_is_of(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    record = run(yard, PuppetRobots(yard.store, 1), yard.request(version, "one"), version.digest)

    robots = describe_deployment_job(yard.store, record.id).robotDeploymentSummary or ()

    assert [robot.progressDetail and robot.progressDetail.targetResource for robot in robots] == [record.arn]


def test_a_reason_of_many_lines_that_a_robot_gives_is_answered_as_one(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    record = run(yard, PuppetRobots(yard.store, 1), yard.request(version, "one"), version.digest)
    before, _, after = record.model_dump_json().rpartition('"failure_reason":""')
    yard.store.put(job_key("deployment-job", record.id), f'{before}"failure_reason":"a\\n b"{after}'.encode())

    robots = describe_deployment_job(yard.store, record.id).robotDeploymentSummary or ()

    assert [robot.failureReason for robot in robots] == ["a b"]


def test_pages_of_robots_follow_one_another_and_hold_each_once(yard: Yard) -> None:
    PuppetRobots(yard.store, 5)
    names: list[str | None] = []
    token = None
    for size in (2, 2, 1):
        page = list_robots_page(yard.store, ListRobotsRequest(maxResults=2, nextToken=token))
        names += [robot.name for robot in page.robots or ()]
        assert len(page.robots or ()) == size
        token = page.nextToken
    assert token is None
    assert names == [f"r{number}" for number in range(5)]


def test_filters_are_alternatives(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 4), yard.publish({"run.sh": STAYS_UP})
    robots.failing = {"r3"}
    run(yard, robots, yard.request(version, "one"), version.digest)
    statuses = [("Failed", {"r3"}), ("InSync", {"r0", "r1", "r2"}), ("Available", set[str]())]
    for status, names in statuses:
        asked = ListRobotsRequest.model_validate({"filters": [{"name": "status", "values": [status]}]})
        assert {robot.name for robot in list_robots_page(yard.store, asked).robots or ()} == names
    either = [{"name": "status", "values": [status]} for status in ("Failed", "InSync")]
    assert len(list_robots_page(yard.store, ListRobotsRequest.model_validate({"filters": either})).robots or ()) == 4
    both = [either[0], {"name": "fleetName", "values": [FLEET]}]
    with pytest.raises(DocumentError, match="of one name"):  # as the older interface says
        list_robots_page(yard.store, ListRobotsRequest.model_validate({"filters": both}))


def test_deployments_are_filtered_by_status_and_fleet(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 1), yard.publish({"run.sh": STAYS_UP})
    run(yard, robots, yard.request(version, "one"), version.digest)
    robots.failing = {"r0"}
    run(yard, robots, yard.request(yard.publish({"run.sh": STAYS_UP + "#\n"}), "two"), _newest(yard))
    for name, value, count in (("status", "Failed", 1), ("status", "Succeeded", 1), ("fleetName", FLEET, 2)):
        asked = ListDeploymentJobsRequest.model_validate({"filters": [{"name": name, "values": [value]}]})
        assert len(list_deployment_jobs_page(yard.store, asked).deploymentJobs or ()) == count


def test_fleets_are_found_by_name(yard: Yard) -> None:
    create_fleet(yard.store, "cleaners")
    asked = ListFleetsRequest.model_validate({"filters": [{"name": "name", "values": ["cleaners"]}]})
    assert [fleet.name for fleet in list_fleets_page(yard.store, asked).fleetDetails or ()] == ["cleaners"]


def test_another_filter_and_a_made_up_token_are_refused(yard: Yard) -> None:
    asked = ListFleetsRequest.model_validate({"filters": [{"name": "colour", "values": ["red"]}]})
    with pytest.raises(DocumentError, match="colour"):
        list_fleets_page(yard.store, asked)
    with pytest.raises(DocumentError, match="nextToken"):
        list_fleets_page(yard.store, ListFleetsRequest(nextToken="made-up"))


def _newest(yard: Yard) -> str:
    return yard.publish({"run.sh": STAYS_UP + "#\n"}).digest


def deployed(store: Store, folder: Path) -> JobRecord:
    create_fleet(store, FLEET)
    yard, robots = Yard(store, folder), PuppetRobots(store, 3)
    robots.failing = {"r1"}
    version = yard.publish({"run.sh": STAYS_UP})
    return run(yard, robots, yard.request(version, "one"), version.digest)


def test_each_robot_is_a_row_that_says_why_it_failed(file_store: Store, tmp_path: Path) -> None:
    view = view_deployment(file_store, deployed(file_store, tmp_path).id)

    rows = {row["robot"]: row for row in robot_rows(view)}

    assert {name: row["status"] for name, row in rows.items()} == {"r0": "InSync", "r1": "Failed", "r2": "InSync"}
    assert rows["r1"]["why"].startswith("PreLaunchFileFailure")


def test_a_deployment_that_nobody_signed_says_so(file_store: Store, tmp_path: Path) -> None:
    record = deployed(file_store, tmp_path)
    view = view_deployment(file_store, record.id)
    said = "Succeeded: 2 of 3 robots run courier 1 (r0, r2), 1 runs nothing; failed, left with nothing: r1"

    assert deployment_sentence(view) == f"{said}. {UNSIGNED_ALARM}"
    signed = record.model_copy(update={"detail": {**record.detail, "trust": "somebody"}})
    assert deployment_sentence(replace(view, record=signed)) == said
