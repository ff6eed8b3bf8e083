from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.deploy.fleet_descriptions import (
    describe_deployment_job,
    describe_fleet,
    describe_robot,
    list_fleets,
    list_robots,
)
from tasks.storage.base.keys import job_key, reported_key
from tasks.storage.base.store import Store
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
