"""Calls about fleets and robots."""

from pathlib import Path
from typing import Any

import pytest

from specs.errors import ConcurrentDeployment, DocumentError, LimitExceeded, ResourceAlreadyExists, ResourceNotFound
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, members, read_robot, register_robot
from tasks.deploy.trust.repository import init_keys
from tasks.deploy.trust.signer import open_signer
from tasks.storage.base.keys import fleet_key
from tasks.storage.base.store import Store
from tests.flows.gateway.jobs.asked import Asked

GROUP = "12345678-1234-1234-1234-123456789012"


def robot(gateway: Asked, name: str = "r", **more: Any) -> dict[str, Any]:  # noqa: ANN401 - RoboMaker's
    return gateway.call("CreateRobot", name=name, architecture="ARM64", greengrassGroupId=GROUP, **more)


def fleet(gateway: Asked, name: str = "f", **more: Any) -> str:  # noqa: ANN401 - RoboMaker's
    return gateway.call("CreateFleet", name=name, **more)["arn"]


def test_a_fleet_is_described_with_its_robots(gateway: Asked) -> None:
    made = gateway.call("CreateFleet", name="f", tags={"site": "north"})
    member = robot(gateway)["arn"]
    answer = gateway.call("RegisterRobot", fleet=made["arn"], robot=member)
    assert answer == {"fleet": made["arn"], "robot": member}
    described = gateway.call("DescribeFleet", fleet=made["arn"])
    assert {name: described[name] for name in made} == made
    (listed,) = described["robots"]
    assert (listed["arn"], listed["status"], listed["greenGrassGroupId"]) == (member, "Registered", GROUP)


def test_a_robot_is_answered_as_it_was_asked_for(gateway: Asked) -> None:
    made = robot(gateway, tags={"site": "north"})
    assert (made["architecture"], made["greengrassGroupId"], made["tags"]) == ("ARM64", GROUP, {"site": "north"})
    described = gateway.call("DescribeRobot", robot=made["arn"])
    assert {name: described[name] for name in made} == made
    assert described["status"] == "Available"


def test_the_same_fleet_is_made_once(gateway: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_MAX_FLEETS", "1")
    made = gateway.call("CreateFleet", name="f", tags={"site": "north"})
    assert gateway.call("CreateFleet", name="f") == made
    with pytest.raises(LimitExceeded, match="SIMYARD_MAX_FLEETS"):
        fleet(gateway, "g")


def test_a_robots_name_is_taken_once(gateway: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_MAX_ROBOTS", "1")
    robot(gateway)
    with pytest.raises(ResourceAlreadyExists):
        robot(gateway)
    with pytest.raises(LimitExceeded, match="SIMYARD_MAX_ROBOTS"):
        robot(gateway, "s")


def test_a_fleet_takes_no_robot_too_many(gateway: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_MAX_FLEET_ROBOTS", "1")
    full, empty = fleet(gateway), fleet(gateway, "g")
    first, second = robot(gateway)["arn"], robot(gateway, "s")["arn"]
    for _ in range(2):
        gateway.call("RegisterRobot", fleet=full, robot=first)
    with pytest.raises(LimitExceeded, match="SIMYARD_MAX_FLEET_ROBOTS"):
        gateway.call("RegisterRobot", fleet=full, robot=second)
    assert gateway.call("RegisterRobot", fleet=empty, robot=second)


def test_a_robot_belongs_to_one_fleet(gateway: Asked) -> None:
    first, second, member = fleet(gateway), fleet(gateway, "g"), robot(gateway)["arn"]
    gateway.call("RegisterRobot", fleet=first, robot=member)
    with pytest.raises(DocumentError, match="it is in f"):
        gateway.call("RegisterRobot", fleet=second, robot=member)
    with pytest.raises(ResourceNotFound, match="the fleet g"):
        gateway.call("DeregisterRobot", fleet=second, robot=member)
    assert gateway.call("DeregisterRobot", fleet=first, robot=member) == {"fleet": first, "robot": member}
    assert gateway.call("DescribeRobot", robot=member)["status"] == "Available"


def test_the_robots_of_a_deleted_fleet_are_in_none(gateway: Asked) -> None:
    made, member = fleet(gateway), robot(gateway)["arn"]
    gateway.call("RegisterRobot", fleet=made, robot=member)
    assert gateway.call("DeleteFleet", fleet=made) == {}
    assert "fleetArn" not in gateway.call("DescribeRobot", robot=member)
    assert gateway.call("DeleteRobot", robot=member) == {}
    for call, members_ in [
        ("DescribeFleet", {"fleet": made}),
        ("DescribeRobot", {"robot": member}),
        ("DeleteFleet", {"fleet": made}),
        ("DeleteRobot", {"robot": member}),
        ("RegisterRobot", {"fleet": made, "robot": member}),
        ("DeregisterRobot", {"fleet": made, "robot": member}),
    ]:
        with pytest.raises(ResourceNotFound):
            gateway.call(call, **members_)


def test_a_robot_never_stays_in_a_fleet_that_goes_meanwhile(file_store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    create_fleet(file_store, "f")
    create_robot(file_store, "r")
    replace = file_store.replace

    def after_the_deletion(key: str, body: bytes, etag: str) -> str:
        monkeypatch.undo()
        file_store.delete(fleet_key("f"))
        return replace(key, body, etag)

    monkeypatch.setattr(file_store, "replace", after_the_deletion)
    with pytest.raises(ResourceNotFound):
        register_robot(file_store, "f", "r")
    assert read_robot(file_store, "r")[0].fleet == ""


def test_a_fleet_with_a_deployment_under_way_stays(gateway: Asked) -> None:
    gateway.publish()
    made = gateway.fleet()
    deployment = gateway.call("CreateDeploymentJob", **gateway.deployment_request(made))["arn"]
    described = gateway.call("DescribeFleet", fleet=made)
    assert (described["lastDeploymentJob"], described["lastDeploymentStatus"]) == (deployment, "Pending")
    with pytest.raises(ConcurrentDeployment):
        gateway.call("DeleteFleet", fleet=made)


def test_a_robot_that_is_registered_without_keys_is_in_no_signed_fleet(gateway: Asked, tmp_path: Path) -> None:
    store, keys = gateway.store, tmp_path / "keys"
    init_keys(store, keys)
    made, own, foreign = fleet(gateway), robot(gateway, "own")["arn"], robot(gateway, "foreign")["arn"]
    gateway.call("RegisterRobot", fleet=made, robot=own)
    signer = open_signer(store, keys)
    signer.vouch(lambda fleets: fleets.enlisted("f", ["own"]))
    before = {key: store.get(key).body for key in store.keys("trust")}
    gateway.call("RegisterRobot", fleet=made, robot=foreign)
    gateway.call("DeregisterRobot", fleet=made, robot=own)
    gateway.call("DeleteRobot", robot=own)
    assert [each.name for each in members(store, "f")] == ["foreign"]
    assert signer.fleets().strangers("f", ["foreign"]) == ["foreign"]
    assert {key: store.get(key).body for key in store.keys("trust")} == before
    assert signer.fleets().robots == {"own": "f"}


def test_what_is_left_to_who_has_the_keys_is_logged(
    gateway: Asked, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    made, member = fleet(gateway), robot(gateway)["arn"]
    gateway.call("RegisterRobot", fleet=made, robot=member)
    assert not caplog.messages
    init_keys(gateway.store, tmp_path / "keys")
    gateway.call("DeregisterRobot", fleet=made, robot=member)
    assert "simyard fleet deregister r" in caplog.text
