"""Robots of several architectures in one fleet, and versions with a bundle for some of them."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from flows.cli.shell import app
from specs.errors import DocumentError
from specs.field_types import Architecture
from specs.robomaker.applications import SourceConfig
from specs.robomaker.bundle import Version
from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.applications.bucket_sources import create_application, create_version
from tasks.applications.registry import pack, publish_bundle
from tasks.deploy.fleet.fleet_registry import create_robot, members, read_desired, register_robot
from tasks.deploy.kit.local_agents import local_agents
from tasks.deploy.rollout.deployment_job import run_deployment_job, run_sync_job
from tasks.deploy.rollout.observation import recorded_progress
from tasks.deploy.rollout.resolved_request import latest_deployment, plan_sync, preflight
from tasks.deploy.rollout.rollout_plan import RolloutPlan
from tasks.deploy.trust.trust_record import Admission
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.records import JobRecord
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.trust.signed_fleet import Owner
from tests.deploy.yard import FLEET, STAYS_UP, Yard


def _folder(yard: Yard, content: str) -> Path:
    package = yard.folder / f"bundle-{content}" / "courier"
    package.mkdir(parents=True, exist_ok=True)
    (package / "run.sh").write_text(STAYS_UP + f"# {content}\n")
    (package / "run.sh").chmod(0o755)
    return package.parent


def _version(yard: Yard) -> Version:
    folders: dict[Architecture, Path] = {"X86_64": _folder(yard, "amd"), "ARM64": _folder(yard, "arm")}
    return publish_bundle(yard.store, "robot-application", "courier", folders)


def _join(yard: Yard, robots: PuppetRobots, name: str, architecture: Architecture) -> None:
    create_robot(yard.store, name, architecture)
    register_robot(yard.store, FLEET, name)
    robots.names.append(name)


@pytest.fixture
def robots(yard: Yard) -> PuppetRobots:
    """One robot of each of two architectures."""
    found = PuppetRobots(yard.store, 1)
    _join(yard, found, "arm", "ARM64")
    return found


def _asked(yard: Yard, robot: str) -> str:
    desired, _ = read_desired(yard.store, robot)
    return desired.digest if desired else ""


def _codes(record: JobRecord) -> dict[str, str | None]:
    return {robot: each.failure_code for robot, each in recorded_progress(record).items()}


def test_each_robot_gets_the_bundle_for_its_architecture(yard: Yard, robots: PuppetRobots) -> None:
    version = _version(yard)

    record = run(yard, robots, yard.request(version, "one"), version.digest)

    assert record.status == "Succeeded"
    assert [_asked(yard, robot) for robot in ("r0", "arm")] == [version.digests["X86_64"], version.digests["ARM64"]]


def test_a_bundle_for_all_architectures_goes_to_all_robots(yard: Yard, robots: PuppetRobots) -> None:
    version = yard.publish({"run.sh": STAYS_UP})

    run(yard, robots, yard.request(version, "one"), version.digest)

    assert {_asked(yard, robot) for robot in ("r0", "arm")} == {version.digest}


def test_a_robot_without_a_bundle_fails_and_is_asked_nothing(yard: Yard, robots: PuppetRobots) -> None:
    _join(yard, robots, "old", "ARMHF")
    version = _version(yard)

    record = run(yard, robots, yard.request(version, "one"), version.digest)

    assert record.status == "Succeeded"
    assert _codes(record) == {"r0": None, "arm": None, "old": "MissingRobotApplicationArchitecture"}
    assert _asked(yard, "old") == ""


def test_robots_without_a_bundle_count_as_failed(yard: Yard, robots: PuppetRobots) -> None:
    for name in ("old-1", "old-2", "old-3"):
        _join(yard, robots, name, "ARMHF")
    version = _version(yard)

    record = run(yard, robots, yard.request(version, "one"), version.digest)

    assert (record.status, record.failure_code) == ("Failed", "FailureThresholdBreached")
    assert [_asked(yard, robot) for robot in robots.names] == [""] * 5


def test_a_robot_that_joins_later_gets_its_own_bundle_too(yard: Yard, robots: PuppetRobots) -> None:
    version = _version(yard)
    run(yard, robots, yard.request(version, "one"), version.digest)
    assert plan_sync(yard.store, latest_deployment(yard.store, FLEET)).environments == {}
    for name in ("late", "later"):
        _join(yard, robots, name, "ARM64")

    record = run_sync_job(yard.store, FLEET, token=FLEET, progress=lambda _ended, _all: None, pace=robots.pace)

    assert record.status == "Succeeded"
    assert {_asked(yard, "late"), _asked(yard, "later")} == {version.digests["ARM64"]}


def test_robots_without_a_bundle_are_left_out_of_a_sync_by_name_and_stop_nobody(
    yard: Yard, robots: PuppetRobots
) -> None:
    version = _version(yard)
    run(yard, robots, yard.request(version, "one"), version.digest)
    _join(yard, robots, "old-1", "ARMHF")
    _join(yard, robots, "old-2", "ARMHF")
    _join(yard, robots, "late", "ARM64")

    for token in ("first", "second"):
        record = run_sync_job(yard.store, FLEET, token=token, progress=lambda _ended, _all: None, pace=robots.pace)

        assert record.status == "Succeeded"
        assert not {"old-1", "old-2"} & set(_codes(record))
    assert _asked(yard, "late") == version.digests["ARM64"]
    told = CliRunner().invoke(app, ["fleet", "sync", FLEET, "--store", yard.store.url], catch_exceptions=False).output
    *lines, last = told.splitlines()
    assert lines == [
        "left out, the version has no bundle for their architecture: old-1, old-2",
        f"all other robots of {FLEET} are in sync",
    ]
    assert last.startswith("Succeeded arn:simyard:deployment-job:")


def test_what_lacks_a_robots_architecture_is_told_before_anything_runs(yard: Yard, robots: PuppetRobots) -> None:
    _join(yard, robots, "old", "ARMHF")
    launch = DeploymentLaunchConfig(packageName="courier", launchFile="run.sh")

    (fault,) = preflight(yard.store, fleet=FLEET, local_agents=0, launch=launch, version=_version(yard))

    assert fault.value == "old, of architecture ARMHF"
    assert "X86_64, ARM64 (MissingRobotApplicationArchitecture)" in fault.allowed


@pytest.mark.parametrize(("machine", "known"), [("aarch64", "ARM64"), ("armv7l", "ARMHF"), ("x86_64", "X86_64")])
def test_robots_on_this_machine_are_of_its_architecture(
    machine: str, known: Architecture, file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platform.machine", lambda: machine)
    monkeypatch.setattr("tasks.deploy.kit.local_agents._begin", lambda *_: _Ended())

    with local_agents(file_store, "yard", 1, tmp_path):
        assert [robot.architecture for robot in members(file_store, "yard")] == [known]


class _Ended:
    """An agent that was never started: on another architecture's machine there is none to test with."""

    def terminate(self) -> None:
        pass

    def wait(self, _seconds: float) -> None:
        pass

    def poll(self) -> int:
        return 0


def test_a_demonstration_on_a_machine_without_a_bundle_is_refused_before_anything_runs(
    yard: Yard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platform.machine", lambda: "armv7l")
    launch = DeploymentLaunchConfig(packageName="courier", launchFile="run.sh")

    faults = preflight(yard.store, fleet="new", local_agents=2, launch=launch, version=_version(yard))

    assert [fault.value for fault in faults] == ["new-1, of architecture ARMHF", "new-2, of architecture ARMHF"]


def test_every_bundle_must_have_the_launch_file(yard: Yard, robots: PuppetRobots) -> None:
    other = _folder(yard, "other")
    (other / "courier" / "run.sh").rename(other / "courier" / "go.sh")
    folders: dict[Architecture, Path] = {"X86_64": _folder(yard, "amd"), "ARM64": other}
    version = publish_bundle(yard.store, "robot-application", "courier", folders)
    launch = DeploymentLaunchConfig(packageName="courier", launchFile="run.sh")

    faults = preflight(yard.store, fleet=FLEET, local_agents=0, launch=launch, version=version)

    assert ["the bundle has no" in fault.allowed for fault in faults] == [True]


def test_a_version_whose_source_was_changed_is_not_deployed(yard: Yard, robots: PuppetRobots) -> None:
    bucket = open_bucket(yard.store, "builds")
    bucket.put("one.tar", pack(_folder(yard, "one")))
    source = SourceConfig(s3Bucket="builds", s3Key="one.tar", architecture="X86_64")
    create_application(yard.store, "robot-application", "courier", [source])
    version = create_version(yard.store, "robot-application", "courier")
    bucket.put("one.tar", pack(_folder(yard, "two")))

    with pytest.raises(DocumentError, match="RobotApplicationVersionMismatchedEtag"):
        run(yard, robots, yard.request(version, "one"), version.digest)

    assert robots.asked() == []


def test_the_bundles_of_all_architectures_are_vouched_for(yard: Yard, robots: PuppetRobots, tmp_path: Path) -> None:
    owner, version = Owner(yard.store, tmp_path / "keys"), _version(yard)
    owner.vouch(*robots.names)
    admitted: list[str] = []

    class Noting:
        def __getattr__(self, name: str) -> object:
            return getattr(owner.signer, name)

        def admit(self, wanted: Admission) -> None:
            admitted.extend(wanted.digests)
            owner.signer.admit(wanted)

    record = _run_signed(yard, robots, version, Noting())

    assert record.status == "Succeeded"
    assert sorted(admitted) == sorted(version.digests.values())


def _run_signed(yard: Yard, robots: PuppetRobots, version: Version, signer: object) -> JobRecord:
    request = yard.request(version, "one")
    return run_deployment_job(
        yard.store,
        request,
        digest=version.digest,
        token=request.clientRequestToken,
        progress=lambda _ended, _all: None,
        pace=robots.pace,
        signer=signer,  # pyright: ignore[reportArgumentType] - forwards every method
    )


def test_a_plan_of_before_there_were_builds_is_read_as_one_bundle_for_all() -> None:
    old = {"fleet": "f", "application": "a", "version": 1, "digest": "0" * 64, "at_once": 1, "failures": 1}
    launch = {"packageName": "courier", "launchFile": "run.sh"}
    plan = RolloutPlan.model_validate({**old, "launch": launch, "environments": {"r": {}}, "timeout_s": 1.0})

    assert (plan.digest_for("r"), plan.lacking()) == ("0" * 64, {})
