"""What is told before a pipeline begins that would stop it at its end."""

from functools import partial
from pathlib import Path

import pytest

from specs.base import Fault
from specs.errors import DocumentError
from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.applications.registry import publish_bundle
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, register_robot
from tasks.deploy.rollout.resolved_request import check_request, plan_deployment, preflight
from tasks.storage.base.keys import bundle_key
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
    assert "courier/none.sh is not in the bundle" in faults[1].allowed


def test_a_launch_file_must_be_executable(yard: Yard) -> None:
    package = yard.folder / "plain" / "courier"
    package.mkdir(parents=True)
    (package / "run.sh").write_text(STAYS_UP)
    version = publish_bundle(yard.store, "robot-application", "plain", package.parent)

    (fault,) = preflight(yard.store, fleet=FLEET, local_agents=1, launch=_launch(), version=version)

    assert (fault.path, "chmod +x" in fault.allowed) == (f"{LAUNCH}.launchFile", True)


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
