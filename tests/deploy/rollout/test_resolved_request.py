"""Requests for a deployment or a sync: what is planned, and every reason why not."""

from functools import partial
from pathlib import Path

import pytest

from specs.base import Fault
from specs.errors import DocumentError, IdempotentParameterMismatch, ResourceNotFound
from specs.pipeline.simulation_section import RollOutRules
from specs.robomaker.bundle import Version
from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.applications.registry import publish_bundle
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.deploy.fleet_descriptions import describe_deployment_job, describe_fleet
from tasks.deploy.rollout.deployment_job import run_deployment_job, run_sync_job
from tasks.deploy.rollout.observation import recorded_progress
from tasks.deploy.rollout.resolved_request import check_request, interpreter_notes, plan_deployment, preflight
from tasks.storage.base.keys import bundle_key
from tasks.storage.jobs.records import JobRecord
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.trust.signed_fleet import Owner
from tests.deploy.yard import FLEET, STAYS_UP, Yard

LAUNCH = "deployment.deploymentApplicationConfigs[0].launchConfig"


def _launch(**changes: object) -> DeploymentLaunchConfig:
    return DeploymentLaunchConfig.model_validate({"packageName": "courier", "launchFile": "run.sh", **changes})


def _faults(yard: Yard, *, fleet: str = FLEET, local_agents: int = 2, **launch: object) -> list[Fault]:
    version = yard.publish({"run.sh": STAYS_UP})
    return preflight(yard.store, fleet=fleet, local_agents=local_agents, launch=_launch(**launch), version=version)


def test_what_can_be_deployed_has_no_faults_and_leaves_the_store_as_it_is(yard: Yard) -> None:
    yard.publish({"run.sh": STAYS_UP})
    before = yard.store.keys("")

    assert _faults(yard, fleet="new") == []
    assert yard.store.keys("") == before


def test_a_fleet_of_its_own_must_be_there(yard: Yard) -> None:
    (fault,) = _faults(yard, fleet="nobody", local_agents=0)

    assert (fault.path, fault.value) == ("deployment.fleet", "'nobody'")


def test_a_fleet_of_its_own_must_have_robots(yard: Yard) -> None:
    (fault,) = _faults(yard, local_agents=0)
    create_robot(yard.store, "r1")
    register_robot(yard.store, FLEET, "r1")

    assert (fault.path, "at least one robot" in fault.allowed) == ("deployment.fleet", True)
    assert _faults(yard, local_agents=0) == []


@pytest.mark.parametrize(("name", "robots", "good"), [("f" * 62, 9, True), ("f" * 62, 10, False), ("a b", 1, False)])
def test_robots_of_a_demonstration_must_have_names(name: str, robots: int, good: bool, yard: Yard) -> None:  # noqa: FBT001 - a case
    assert [fault.path for fault in _faults(yard, fleet=name, local_agents=robots)] == (
        [] if good else ["deployment.fleet.name"]
    )


def test_robots_of_a_demonstration_are_not_taken_from_another_fleet(yard: Yard) -> None:
    create_fleet(yard.store, "cleaners")
    create_robot(yard.store, f"{FLEET}-2")
    register_robot(yard.store, "cleaners", f"{FLEET}-2")

    (fault,) = _faults(yard)

    assert (fault.path, fault.value) == ("deployment.fleet.name", f"{FLEET}-2")


def test_all_faults_of_a_launch_configuration_are_told_at_once(yard: Yard) -> None:
    faults = _faults(
        yard, preLaunchFile="../up.sh", postLaunchFile="none.sh", environmentVariables={"PATH": "x", "FINE": "y"}
    )

    assert [fault.path for fault in faults] == [
        f"{LAUNCH}.preLaunchFile",
        f"{LAUNCH}.postLaunchFile",
        f"{LAUNCH}.environmentVariables.PATH",
    ]
    assert "the bundle has no courier/none.sh" in faults[1].allowed


def test_a_launch_file_must_be_executable(yard: Yard) -> None:
    package = yard.folder / "plain" / "courier"
    package.mkdir(parents=True)
    (package / "run.sh").write_text(STAYS_UP)
    version = publish_bundle(yard.store, "robot-application", "plain", package.parent)

    (fault,) = preflight(yard.store, fleet=FLEET, local_agents=1, launch=_launch(), version=version)

    assert (fault.path, "chmod +x" in fault.allowed) == (f"{LAUNCH}.launchFile", True)


CRLF = "#!/bin/sh\r\nexec sleep 1000\r\n"
OLD = "#!/usr/bin/env python2\n"
ELF_OF_ARM = "\x7fELF\x02\x01\x01" + "\0" * 11 + "\xb7\0" + "\0" * 40


@pytest.mark.parametrize(
    ("text", "here", "said"),
    [
        (CRLF, 1, "courier/run.sh, line 1: ends in CR LF, and the CR counts to the interpreter's name: dos2unix"),
        (CRLF, 0, "courier/run.sh, line 1: ends in CR LF"),
        ("exec sleep 1000\n", 0, "courier/run.sh, line 1: says not what runs it: begin it with #!/bin/sh"),
        (OLD, 1, "courier/run.sh, line 1: needs python2, which this machine lacks"),
        (ELF_OF_ARM, 1, "courier/run.sh is compiled for ARM64, and not for robots of X86_64"),
        (ELF_OF_ARM, 0, "courier/run.sh is compiled for ARM64, and not for robots of X86_64"),
    ],
)
def test_a_launch_file_that_starts_nowhere_is_a_fault(text: str, here: int, said: str, yard: Yard) -> None:
    version = _published(yard, text)
    (fault,) = preflight(yard.store, fleet=FLEET, local_agents=here, launch=_launch(), version=version)
    assert fault.path == f"{LAUNCH}.launchFile"
    assert f"a file that can be started; {said}" in fault.allowed


def test_what_a_script_needs_may_be_on_robots_alone(yard: Yard) -> None:
    version = _published(yard, OLD)
    assert preflight(yard.store, fleet=FLEET, local_agents=0, launch=_launch(), version=version) == []
    notes = list(interpreter_notes(yard.store, _launch(), version))
    assert notes == ["courier/run.sh needs python2 on each robot; this machine has none"]


def _published(yard: Yard, text: str) -> Version:
    """Returns a version whose launch file is this text, in Latin-1, and a fleet of one robot."""
    create_robot(yard.store, "r1")
    register_robot(yard.store, FLEET, "r1")
    package = yard.folder / "started" / "courier"
    package.mkdir(parents=True)
    (package / "run.sh").write_bytes(text.encode("latin-1"))
    (package / "run.sh").chmod(0o755)
    return publish_bundle(yard.store, "robot-application", "courier", package.parent)


@pytest.mark.parametrize("body", [b"", b"noise" * 1000, None])
def test_a_bundle_that_is_no_archive_or_is_gone_is_a_fault(body: bytes | None, yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    yard.store.delete(bundle_key(version.digest))
    if body is not None:
        yard.store.put(bundle_key(version.digest), body)

    (fault,) = preflight(yard.store, fleet=FLEET, local_agents=1, launch=_launch(), version=version)

    assert fault.path == "deployment.deploymentApplicationConfigs[0].application"


def test_robots_that_no_key_vouches_for_are_told_before_anything_runs(yard: Yard, tmp_path: Path) -> None:
    version, owner = yard.publish({"run.sh": STAYS_UP}), Owner(yard.store, tmp_path / "keys")
    create_robot(yard.store, "r1")
    register_robot(yard.store, FLEET, "r1")
    told = partial(preflight, yard.store, fleet=FLEET, local_agents=0, launch=_launch(), version=version)

    (fault,) = told(signer=owner.signer)
    owner.vouch("r1")

    assert fault.path == "deployment.fleet"
    assert "simyard fleet vouch couriers" in fault.allowed
    assert told(signer=owner.signer) == []
    assert told() == []


def test_a_version_whose_builds_are_not_those_that_were_tested_is_refused(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    create_robot(yard.store, "r1")
    register_robot(yard.store, FLEET, "r1")
    request = yard.request(version, "one")

    assert plan_deployment(yard.store, request, version.digest, builds={}).builds == {}
    with pytest.raises(
        DocumentError, match=f"1, with one bundle for all .*: the version as it was .*{'f' * 64} for ARM64"
    ):
        plan_deployment(yard.store, request, version.digest, builds={"ARM64": "f" * 64})
    with pytest.raises(DocumentError, match="the version as it was tested"):
        check_request(yard.store, request, version.digest, {"ARM64": "f" * 64})


def sync(
    yard: Yard,
    robots: PuppetRobots,
    token: str = "sync",  # noqa: S107 - of a client request
    *,
    only_failed: bool = False,
) -> JobRecord:
    return run_sync_job(
        yard.store, FLEET, token=token, progress=lambda *_: None, only_failed=only_failed, pace=robots.pace
    )


def test_a_robot_that_joined_later_gets_what_the_others_run(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 2), yard.publish({"run.sh": STAYS_UP})
    first = run(yard, robots, yard.request(version, "one"), version.digest)
    yard.publish({"run.sh": STAYS_UP, "newer.sh": STAYS_UP})
    create_robot(yard.store, "late")
    register_robot(yard.store, FLEET, "late")
    robots.names.append("late")

    record = sync(yard, robots)

    assert record.status == "Succeeded"
    assert list(recorded_progress(record)) == ["late"]
    assert [desired.digest for desired in robots.asked()] == [version.digest] * 3
    assert {desired.deployment for desired in robots.asked() if desired.robot != "late"} == {first.id}


def test_only_those_that_failed_are_tried_again(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 5), yard.publish({"run.sh": STAYS_UP})
    robots.failing = {"r3"}
    run(yard, robots, yard.request(version, "one"), version.digest)
    robots.failing = set()

    record = sync(yard, robots)

    assert record.status == "Succeeded"
    assert list(recorded_progress(record)) == ["r3"]


def test_those_that_joined_later_or_were_left_out_may_be_kept_out_of_it(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 5), yard.publish({"run.sh": STAYS_UP})
    robots.failing = {"r0", "r1"}
    first = run(yard, robots, yard.request(version, "one"), version.digest)
    assert [each.failure_code for each in recorded_progress(first).values()].count("RobotDeploymentAborted") == 3
    create_robot(yard.store, "late")
    register_robot(yard.store, FLEET, "late")
    robots.failing = set()

    retried = sync(yard, robots, "retry", only_failed=True)

    assert retried.status == "Succeeded"
    assert list(recorded_progress(retried)) == ["r0", "r1"]
    robots.names.append("late")
    assert list(recorded_progress(sync(yard, robots))) == ["r2", "r3", "r4", "late"]


def test_who_does_not_answer_is_tried_again_like_who_failed(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 5, step_s=10_000.0), yard.publish({"run.sh": STAYS_UP})
    robots.silent = {"r4"}
    run(yard, robots, yard.request(version, "one"), version.digest)
    robots.silent = set()

    retried = sync(yard, robots, "retry", only_failed=True)

    assert (retried.status, list(recorded_progress(retried))) == ("Succeeded", ["r4"])


def test_a_fleet_in_sync_is_synced_without_asking_anybody(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 2), yard.publish({"run.sh": STAYS_UP})
    first = run(yard, robots, yard.request(version, "one"), version.digest)

    record = sync(yard, robots)

    assert record.status == "Succeeded"
    assert {desired.deployment for desired in robots.asked()} == {first.id}


def test_a_sync_is_a_deployment_job_of_its_own_and_the_same_token_is_the_same_job(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 2), yard.publish({"run.sh": STAYS_UP})
    first = run(yard, robots, yard.request(version, "one"), version.digest)

    record = sync(yard, robots)

    described = describe_deployment_job(yard.store, record.id)
    assert record.id != first.id
    assert described.deploymentApplicationConfigs == yard.request(version, "one").deploymentApplicationConfigs
    assert described.tags is None
    assert sync(yard, robots) == record


def test_after_a_sync_comes_a_sync_of_the_same(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 3), yard.publish({"run.sh": STAYS_UP})
    robots.failing = {"r1"}
    run(yard, robots, yard.request(version, "one"), version.digest)
    assert sync(yard, robots, "two").status == "Failed"
    robots.failing = set()
    assert sync(yard, robots, "three").status == "Succeeded"


def test_a_fleet_without_a_deployment_has_nothing_to_be_brought_to(yard: Yard) -> None:
    with pytest.raises(ResourceNotFound, match="something was deployed"):
        sync(yard, PuppetRobots(yard.store, 1))


def test_a_failed_canary_leaves_the_fleet_alone(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 5), yard.publish({"run.sh": STAYS_UP})
    robots.failing = {"r0"}
    record = run_deployment_job(
        yard.store,
        yard.request(version, "one"),
        digest=version.digest,
        token="one",  # noqa: S106 - of a client request
        progress=lambda *_: None,
        rules=RollOutRules(canaryRobots=1),
        pace=robots.pace,
    )
    assert (record.status, record.failure_code) == ("Failed", "FailureThresholdBreached")
    assert "; a canary failed; 1 of 5 robots failed (r0: PreLaunchFileFailure)" in record.failure_reason
    assert [desired.robot for desired in robots.asked()] == ["r0"]


def test_robots_that_run_the_bytes_in_another_way_are_brought_along(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 5), yard.publish({"run.sh": STAYS_UP, "other.sh": STAYS_UP})
    run(yard, robots, yard.request(version, "one"), version.digest)
    robots.failing = {"r0", "r1"}
    other = yard.request(version, "two", launchFile="other.sh", environmentVariables={"SPEED": "2"})
    assert run(yard, robots, other, version.digest).status == "Failed"
    robots.failing = set()

    assert sync(yard, robots).status == "Succeeded"

    assert {desired.launch.launchFile for desired in robots.asked()} == {"other.sh"}
    assert all(desired.environment == {"SPEED": "2"} for desired in robots.asked())


def test_a_deployment_that_was_killed_before_its_plan_does_not_hide_the_one_before(
    yard: Yard, monkeypatch: pytest.MonkeyPatch
) -> None:
    robots, version = PuppetRobots(yard.store, 2), yard.publish({"run.sh": STAYS_UP})
    run(yard, robots, yard.request(version, "one"), version.digest)

    def killed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("tasks.deploy.rollout.deployment_job.advance", killed)
        with pytest.raises(KeyboardInterrupt):
            run(yard, robots, yard.request(version, "two"), version.digest)
    create_robot(yard.store, "late")
    register_robot(yard.store, FLEET, "late")
    robots.names.append("late")
    record = sync(yard, robots)
    assert record.status == "Succeeded"
    assert list(recorded_progress(record)) == ["late"]


def test_a_sync_with_nothing_to_do_is_a_job_that_succeeded_and_the_latest_of_its_fleet(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 2), yard.publish({"run.sh": STAYS_UP})
    first = run(yard, robots, yard.request(version, "one"), version.digest)

    record = sync(yard, robots, "again")

    described = describe_deployment_job(yard.store, record.id)
    assert (record.status, described.robotDeploymentSummary) == ("Succeeded", ())
    assert record.id != first.id
    assert describe_fleet(yard.store, FLEET).lastDeploymentJob == record.arn
    assert {desired.deployment for desired in robots.asked()} == {first.id}
    create_robot(yard.store, "late")
    register_robot(yard.store, FLEET, "late")
    robots.names.append("late")
    assert list(recorded_progress(sync(yard, robots, "later"))) == ["late"]


def test_the_token_of_a_sync_is_the_same_job_and_of_another_fleet_a_mismatch(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 2), yard.publish({"run.sh": STAYS_UP})
    run(yard, robots, yard.request(version, "one"), version.digest)
    create_fleet(yard.store, "others")
    request = yard.request(version, "two")
    other = request.model_copy(update={"fleet": request.fleet.replace(FLEET, "others")})
    create_robot(yard.store, "o1")
    register_robot(yard.store, "others", "o1")
    others = PuppetRobots(yard.store, 0)
    others.names = ["o1"]
    run(yard, others, other, version.digest)

    record = sync(yard, robots, "tok")

    assert sync(yard, robots, "tok") == record
    with pytest.raises(IdempotentParameterMismatch):
        run_sync_job(yard.store, "others", token="tok", progress=lambda *_: None, pace=robots.pace)  # noqa: S106 - of a client request
