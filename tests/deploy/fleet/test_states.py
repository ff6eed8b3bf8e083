"""What the store holds for fleets and robots, and records that are damaged."""

import json

import pytest
from pydantic import ValidationError

from specs.errors import ResourceNotFound
from tasks.deploy.fleet.fleet_registry import create_fleet, create_robot, read_robot, register_robot
from tasks.deploy.fleet.reservation import delete_fleet, delete_robot
from tasks.deploy.fleet.states import Desired, Reported, progress_of
from tasks.deploy.fleet_descriptions import describe_fleet, list_fleets, list_robots
from tasks.deploy.rollout.observation import recorded_progress
from tasks.storage.base.keys import fleet_key, robot_record_key
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard, desired_state

DESIRED = desired_state(deployment="dep-2", sequence=2, issued_at_s=1000.0)
REPORTED = Reported(
    robot="r1", deployment="dep-2", sequence=2, boot_id="b", status="Deploying", step="Launching", started_at_s=1001.0
)
DONE = REPORTED.model_copy(update={"status": "InSync", "step": "Finished", "finished_at_s": 1010.0})
_FOREIGN = b'{"name": "../r2", "architecture": "X86_64", "created_at_s": 1, "tags": {}, "fleet": "couriers"}'
_NOT_FINITE = b'{"name": "r1", "architecture": "X86_64", "created_at_s": NaN, "tags": {}, "fleet": "couriers"}'


@pytest.mark.parametrize(
    ("reported", "now_s", "status"),
    [
        (None, 1059.0, "PendingNewDeployment"),
        (None, 1061.0, "NoResponse"),
        (REPORTED, 1059.0, "Deploying"),
        (REPORTED, 1061.0, "NoResponse"),
        (DONE, 1059.0, "InSync"),
        (DONE, 9999.0, "InSync"),
        (DONE.model_copy(update={"sequence": 1, "deployment": "dep-1"}), 1059.0, "PendingNewDeployment"),
        (DONE.model_copy(update={"sequence": 1}), 1059.0, "PendingNewDeployment"),
    ],
)
def test_a_robots_status_follows_from_what_was_asked_and_what_it_says(
    reported: Reported | None, now_s: float, status: str
) -> None:
    assert progress_of(DESIRED, reported, now_s=now_s).status == status


def test_a_robot_that_does_not_answer_says_so_with_robomakers_code() -> None:
    progress = progress_of(DESIRED, None, now_s=2000.0)

    assert (progress.failure_code, progress.finished_at_s) == ("RobotDeploymentNoResponse", 2000.0)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *[("sequence", value) for value in ("0", "9007199254740993", "9" * 4300, "1e30", "NaN")],
        *[("epoch", value) for value in ("0", "9" * 30)],
        *[("version", value) for value in ("0", "9" * 30)],
        *[
            (field, value)
            for field in ("timeout_s", "issued_at_s", "expires_at_s")
            for value in ("-1", "1e12", "Infinity", "NaN")
        ],
        ("deployment", '"a\\nb"'),
        ("robot", '""'),
        ("application", '"' + "x" * 300 + '"'),
    ],
)
def test_a_desired_state_with_a_value_that_nobody_writes_is_none(field: str, value: str) -> None:
    document = json.loads(DESIRED.model_dump_json())
    document[field] = "HERE"

    with pytest.raises(ValidationError, match=field):
        Desired.model_validate_json(json.dumps(document).replace('"HERE"', value))


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
    assert read_robot(yard.store, "r0").fleet == ""


@pytest.mark.parametrize("body", [b"\xff", b"[]", b" " * (2 << 20), b'{"name": "?", "created_at_s": 1, "tags": {}}'])
def test_a_spoilt_fleet_is_named_and_the_others_are_listed(
    body: bytes, yard: Yard, caplog: pytest.LogCaptureFixture
) -> None:
    create_fleet(yard.store, "cleaners")
    yard.store.put(fleet_key("cleaners"), body)

    assert [fleet.name for fleet in list_fleets(yard.store)] == [FLEET]
    assert [each for each in caplog.messages if "fleet cleaners is left out" in each]
