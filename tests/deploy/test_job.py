"""Which deployment jobs are made, refused, continued and described."""

from pathlib import Path

import pytest

from specs.deployment import CreateDeploymentJobRequest
from specs.errors import (
    ConcurrentDeployment,
    DocumentError,
    IdempotentParameterMismatch,
    ResourceNotFound,
)
from tasks.deploy.describe import describe_deployment_job, list_deployment_jobs
from tasks.deploy.fleets import read_fleet
from tasks.storage.claim import claimed
from tasks.storage.encoding import encoded
from tasks.storage.keys import claim_key, fleet_key
from tasks.storage.opening import open_store
from tasks.storage.records import job_id, read, records, submit
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard

KIND = "deployment-job"


def test_an_ended_job_is_returned_as_it_ended_and_nothing_is_asked_again(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 2)
    first = run(yard, robots, yard.request(version, "one"), version.digest)
    asked = robots.asked()

    assert run(yard, robots, yard.request(version, "one"), version.digest) == first
    assert robots.asked() == asked


def test_a_deployment_is_its_fleets_last_from_then_on(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    record = run(yard, PuppetRobots(yard.store, 1), yard.request(version, "one"), version.digest)

    assert read_fleet(yard.store, FLEET)[0].deployment == record.id


def test_the_next_deployment_has_the_next_sequence(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 2)
    for token in ("one", "two"):
        run(yard, robots, yard.request(version, token), version.digest)

    assert [(desired.sequence, desired.deployment) for desired in robots.asked()] == [(2, job_id(KIND, "two"))] * 2


def test_a_token_with_another_request_is_refused(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 1)
    run(yard, robots, yard.request(version, "one"), version.digest)

    with pytest.raises(IdempotentParameterMismatch):
        run(yard, robots, yard.request(version, "one", preLaunchFile="x.sh"), version.digest)


def test_a_version_that_was_not_tested_is_refused_before_there_is_a_job(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})

    with pytest.raises(DocumentError, match="the version that was tested"):
        run(yard, PuppetRobots(yard.store, 1), yard.request(version, "one"), "0" * 64)

    assert records(yard.store, KIND) == []


def test_all_faults_of_a_deployment_are_told_at_once(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    request = yard.request(
        version, "one", preLaunchFile="../../up.sh", environmentVariables={"LD_PRELOAD": "x", "PATH": "y", "FINE": "z"}
    )

    with pytest.raises(DocumentError) as caught:
        run(yard, PuppetRobots(yard.store, 0), request, "0" * 64)

    prefix = "deploymentApplicationConfigs.0."
    assert [fault.path.removeprefix(prefix) for fault in caught.value.faults] == [
        "applicationVersion",
        "launchConfig.preLaunchFile",
        "launchConfig.environmentVariables.LD_PRELOAD",
        "launchConfig.environmentVariables.PATH",
        "fleet",
    ]


@pytest.mark.parametrize(
    "change",
    [
        {"fleet": "arn:simyard:deployment-fleet:x:nobody"},
        {"application": "arn:simyard:robot-application:x:nothing"},
        {"applicationVersion": "2"},
    ],
)
def test_what_does_not_exist_is_missing(change: dict[str, str], yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 1)
    document = yard.request(version, "one").model_dump(exclude_none=True)
    for target in (document, document["deploymentApplicationConfigs"][0]):
        target.update({key: value for key, value in change.items() if key in target})

    with pytest.raises(ResourceNotFound):
        run(yard, robots, CreateDeploymentJobRequest.model_validate(document), version.digest)

    assert records(yard.store, KIND) == []


def _interrupted(yard: Yard, token: str) -> str:
    """Makes a deployment the fleet's active one, as a process that went away leaves it; returns its id."""
    request = yard.request(yard.publish({"run.sh": STAYS_UP}), token).model_dump(mode="json", exclude_none=True)
    other = submit(yard.store, KIND, request, token).id
    fleet, etag = read_fleet(yard.store, FLEET)
    yard.store.replace(fleet_key(FLEET), encoded(fleet.model_copy(update={"deployment": other})), etag)
    return other


def test_a_fleet_takes_one_deployment_at_a_time(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 1)
    other = _interrupted(yard, "other")

    with claimed(yard.store, claim_key(KIND, other)), pytest.raises(ConcurrentDeployment, match="wait for"):
        run(yard, robots, yard.request(version, "one"), version.digest)

    assert [record.id for record in records(yard.store, KIND)] == [other]


def test_a_deployment_that_nobody_works_on_gives_way(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 1)
    other = _interrupted(yard, "other")

    assert run(yard, robots, yard.request(version, "one"), version.digest).status == "Succeeded"
    assert read(yard.store, KIND, other).status == "Canceled"


def test_a_described_job_tells_codes_and_reasons_of_its_robots(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 3)
    robots.failing = {"r0", "r1"}

    record = run(yard, robots, yard.request(version, "one"), version.digest)

    described = describe_deployment_job(yard.store, record.id)
    assert (described.status, described.failureCode) == ("Failed", "FailureThresholdBreached")
    codes = [(each.status, each.failureCode) for each in described.robotDeploymentSummary or ()]
    assert codes == [
        ("Failed", "PreLaunchFileFailure"),
        ("Failed", "PreLaunchFileFailure"),
        ("Failed", "RobotDeploymentAborted"),
    ]
    assert [job.arn for job in list_deployment_jobs(yard.store)] == [record.arn]


def test_a_store_opened_elsewhere_shows_the_same_job(yard: Yard, tmp_path: Path) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    record = run(yard, PuppetRobots(yard.store, 1), yard.request(version, "one"), version.digest)

    assert describe_deployment_job(open_store(yard.store.url), record.id).arn == record.arn
