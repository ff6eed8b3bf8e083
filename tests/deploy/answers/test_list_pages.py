"""Lists of fleets, robots and deployments come in pages, and filtered."""

import pytest

from specs.errors import DocumentError
from specs.robomaker.deployment import ListDeploymentJobsRequest, ListFleetsRequest, ListRobotsRequest
from tasks.deploy.fleet.fleet_registry import create_fleet
from tasks.deploy.fleet_descriptions import list_deployment_jobs_page, list_fleets_page, list_robots_page
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard


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
