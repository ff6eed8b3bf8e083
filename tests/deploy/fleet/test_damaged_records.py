"""Records of robots and fleets that somebody has spoilt: named, left out, and in nobody else's way."""

import pytest

from specs.errors import ResourceNotFound
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, read_robot, register_robot
from tasks.deploy.fleet.reservation import delete_fleet, delete_robot
from tasks.deploy.fleet_descriptions import describe_fleet, list_fleets, list_robots
from tasks.deploy.rollout.observation import recorded_progress
from tasks.storage.base.keys import fleet_key, robot_record_key
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard

_FOREIGN = b'{"name": "../r2", "architecture": "X86_64", "created_at_s": 1, "tags": {}, "fleet": "couriers"}'
_NOT_FINITE = b'{"name": "r1", "architecture": "X86_64", "created_at_s": NaN, "tags": {}, "fleet": "couriers"}'


@pytest.mark.parametrize("body", [b"\xff", b"{}", b" " * (2 << 20), _FOREIGN, _NOT_FINITE])
def test_a_spoilt_record_is_named_and_the_fleet_is_listed_and_deployed_to(
    body: bytes, yard: Yard, caplog: pytest.LogCaptureFixture
) -> None:
    robots, version = PuppetRobots(yard.store, 3), yard.publish({"run.sh": STAYS_UP})
    yard.store.put(robot_record_key("r1"), body)

    listed = [robot.name for robot in list_robots(yard.store)]
    shown = [robot.name for robot in describe_fleet(yard.store, FLEET).robots or ()]
    record = run(yard, robots, yard.request(version, "one"), version.digest)

    assert listed == shown == ["r0", "r2"]
    assert (record.status, list(recorded_progress(record))) == ("Succeeded", ["r0", "r2"])
    assert [each for each in caplog.messages if "robot r1 is left out" in each]


def test_a_robot_whose_record_was_spoilt_is_deleted_and_made_anew(yard: Yard) -> None:
    yard.store.put(robot_record_key("r1"), b"garbage")

    assert delete_robot(yard.store, "r1") == "r1"

    create_robot(yard.store, "r1")
    assert register_robot(yard.store, FLEET, "r1").fleet == FLEET


def test_a_robot_that_is_not_there_is_not_deleted(yard: Yard) -> None:
    with pytest.raises(ResourceNotFound):
        delete_robot(yard.store, "r1")


def test_a_fleet_with_a_spoilt_robot_is_deleted(yard: Yard) -> None:
    PuppetRobots(yard.store, 2)
    yard.store.put(robot_record_key("r1"), b"garbage")

    assert delete_fleet(yard.store, FLEET) == ("r0",)
    assert read_robot(yard.store, "r0")[0].fleet == ""


@pytest.mark.parametrize("body", [b"\xff", b"[]", b" " * (2 << 20), b'{"name": "?", "created_at_s": 1, "tags": {}}'])
def test_a_spoilt_fleet_is_named_and_the_others_are_listed(
    body: bytes, yard: Yard, caplog: pytest.LogCaptureFixture
) -> None:
    create_fleet(yard.store, "cleaners")
    yard.store.put(fleet_key("cleaners"), body)

    assert [fleet.name for fleet in list_fleets(yard.store)] == [FLEET]
    assert [each for each in caplog.messages if "fleet cleaners is left out" in each]
