"""Which deployment jobs are made, refused, continued and described."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from specs.errors import ConcurrentDeployment, DocumentError, IdempotentParameterMismatch, ResourceNotFound, StageFailed
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.deploy.fleet.fleet_registry import change_fleet, create_robot, members, read_fleet, register_robot
from tasks.deploy.fleet_descriptions import describe_deployment_job, list_deployment_jobs
from tasks.deploy.rollout.observation import recorded_progress
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import encode_document
from tasks.storage.jobs.claim import ClaimRecord, ProcessIdentity
from tasks.storage.jobs.records import job_id, read, records, submit
from tasks.storage.store_url import open_store
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard
from tests.factories.lively_claims import hold_lively_claim

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

    assert read_fleet(yard.store, FLEET).deployment == record.id


def test_the_next_deployment_has_a_higher_sequence(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 2)
    run(yard, robots, yard.request(version, "one"), version.digest)
    before = robots.asked()
    run(yard, robots, yard.request(version, "two"), version.digest)

    assert [desired.deployment for desired in robots.asked()] == [job_id(KIND, "two")] * 2
    assert all(new.sequence > old.sequence for new, old in zip(robots.asked(), before, strict=True))


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
    change_fleet(yard.store, FLEET, lambda fleet: fleet.model_copy(update={"deployment": other}))
    return other


def test_a_fleet_takes_one_deployment_at_a_time(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 1)
    other = _interrupted(yard, "other")

    with (
        hold_lively_claim(yard.store, claim_key(KIND, other)),
        pytest.raises(ConcurrentDeployment, match="wait for"),
    ):
        run(yard, robots, yard.request(version, "one"), version.digest)

    assert [record.id for record in records(yard.store, KIND)] == [other]


class Made:
    """The members of a fleet, made when they are entered; tells how often, and whose the fleet was then."""

    def __init__(self, yard: Yard) -> None:
        self.owners: list[str] = []
        self.open = False
        self._yard = yard

    @contextmanager
    def __call__(self) -> Generator[None]:
        self.owners.append(read_fleet(self._yard.store, FLEET).deployment)
        self.open = True
        for name in ("r0", "r1"):
            create_robot(self._yard.store, name)
            register_robot(self._yard.store, FLEET, name)
        yield
        self.open = False


def _puppets(yard: Yard, names: list[str]) -> PuppetRobots:
    robots = PuppetRobots(yard.store, 0)
    robots.names = names
    return robots


def test_a_deployment_that_is_refused_makes_no_robots(yard: Yard) -> None:
    version, made = yard.publish({"run.sh": STAYS_UP}), Made(yard)
    other = _interrupted(yard, "other")

    with hold_lively_claim(yard.store, claim_key(KIND, other)), pytest.raises(ConcurrentDeployment):
        run(yard, _puppets(yard, []), yard.request(version, "one"), version.digest, made=made)

    assert (made.owners, members(yard.store, FLEET)) == ([], [])


def test_robots_are_made_while_the_fleet_is_the_jobs_and_are_deployed_to(yard: Yard) -> None:
    version, made = yard.publish({"run.sh": STAYS_UP}), Made(yard)
    robots = _puppets(yard, ["r0", "r1"])
    open_at_progress: list[bool] = []

    record = run(
        yard,
        robots,
        yard.request(version, "one"),
        version.digest,
        lambda _ended, _all: open_at_progress.append(made.open),
        made=made,
    )

    assert (made.owners, made.open) == ([record.id], False)
    assert set(open_at_progress) == {True}
    assert {robot: each.status for robot, each in recorded_progress(record).items()} == {"r0": "InSync", "r1": "InSync"}


def test_an_ended_job_makes_no_robots_again(yard: Yard) -> None:
    version, made = yard.publish({"run.sh": STAYS_UP}), Made(yard)
    for _ in range(2):
        run(yard, _puppets(yard, ["r0", "r1"]), yard.request(version, "one"), version.digest, made=made)

    assert len(made.owners) == 1


def test_faults_are_told_before_robots_are_made_and_there_is_a_job(yard: Yard) -> None:
    version, made = yard.publish({"run.sh": STAYS_UP}), Made(yard)
    request = yard.request(version, "one", environmentVariables={"PATH": "x"})

    with pytest.raises(DocumentError, match=r"environmentVariables\.PATH"):
        run(yard, _puppets(yard, []), request, version.digest, made=made)

    assert (made.owners, records(yard.store, KIND)) == ([], [])


def test_a_job_that_died_while_its_robots_were_made_is_continued(yard: Yard) -> None:
    version, made = yard.publish({"run.sh": STAYS_UP}), Made(yard)

    @contextmanager
    def dies() -> Generator[None]:
        yield from ()
        raise StageFailed("killed", "as by kill -9")

    with pytest.raises(StageFailed):
        run(yard, _puppets(yard, []), yard.request(version, "one"), version.digest, made=dies)

    record = run(yard, _puppets(yard, ["r0", "r1"]), yard.request(version, "one"), version.digest, made=made)
    assert record.status == "Succeeded"


def test_a_deployment_whose_host_died_gives_way_once_its_claim_was_silent(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 1)
    other = _interrupted(yard, "other")
    elsewhere = ProcessIdentity(host="elsewhere", pid=1, started="1")
    silent = ClaimRecord(owner="other", process=elsewhere, epoch=1, beat=7, ttl_s=0.3, released=False)
    yard.store.create(claim_key(KIND, other), encode_document(silent))

    assert run(yard, robots, yard.request(version, "one"), version.digest).status == "Succeeded"
    assert read(yard.store, KIND, other).status == "Canceled"


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
