"""A fleet of real robots, made on the command line."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from flows.cli.shell import app
from specs.arn import arn
from specs.errors import DocumentError, ResourceNotFound
from tasks.deploy.fleet.fleet_registry import create_fleet, fleets, members, robots
from tasks.storage.base.store import Store
from tasks.storage.store_url import store_id
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard


def _simyard(store: Store, *arguments: str) -> Result:
    return CliRunner().invoke(app, ["fleet", *arguments, "--store", store.url], catch_exceptions=False)


def test_a_fleet_is_made_once_and_its_arn_is_told(file_store: Store) -> None:
    told = {_simyard(file_store, "create", "couriers").output for _ in range(2)}

    assert told == {arn("deployment-fleet", store_id(file_store), "couriers") + "\n"}
    assert [fleet.name for fleet in fleets(file_store)] == ["couriers"]


def test_a_registered_robot_is_made_and_is_no_demonstrations_robot(file_store: Store) -> None:
    create_fleet(file_store, "couriers")

    told = _simyard(file_store, "register", "couriers", "r1").output

    assert told == arn("robot", store_id(file_store), "r1") + "\n"
    assert [(robot.name, robot.local) for robot in members(file_store, "couriers")] == [("r1", False)]


def test_a_robot_of_another_fleet_is_not_taken_from_it(file_store: Store) -> None:
    for fleet in ("couriers", "cleaners"):
        create_fleet(file_store, fleet)
    _simyard(file_store, "register", "couriers", "r1")

    with pytest.raises(DocumentError, match="it is in couriers"):
        _simyard(file_store, "register", "cleaners", "r1")

    assert [robot.name for robot in members(file_store, "couriers")] == ["r1"]


def test_a_robot_is_not_made_for_a_fleet_that_does_not_exist(file_store: Store) -> None:
    with pytest.raises(ResourceNotFound):
        _simyard(file_store, "register", "nobody", "r1")

    assert robots(file_store) == []


def test_a_fleet_is_shown_with_its_robots(file_store: Store) -> None:
    create_fleet(file_store, "couriers")
    for robot in ("r1", "r2"):
        _simyard(file_store, "register", "couriers", robot)

    shown = json.loads(_simyard(file_store, "show", arn("deployment-fleet", store_id(file_store), "couriers")).stdout)

    assert shown["name"] == "couriers"
    assert [(robot["name"], robot["status"]) for robot in shown["robots"]] == [
        ("r1", "Registered"),
        ("r2", "Registered"),
    ]


def test_nothing_is_paused_where_nothing_is_under_way(file_store: Store) -> None:
    create_fleet(file_store, "couriers")
    for command in ("pause", "resume"):
        told = _simyard(file_store, command, "couriers")
        assert (told.exit_code, told.stderr) == (2, "no deployment of couriers is under way\n")
        with pytest.raises(ResourceNotFound):
            _simyard(file_store, command, "nobody")


def test_a_fleet_to_which_nothing_was_deployed_has_nothing_to_watch_or_sync(file_store: Store) -> None:
    create_fleet(file_store, "couriers")
    assert "nothing was deployed" in _simyard(file_store, "watch", "couriers").output
    with pytest.raises(ResourceNotFound, match="something was deployed"):
        _simyard(file_store, "sync", "couriers", "--unsigned")


def test_a_sync_with_nothing_to_do_is_a_deployment_that_its_token_names(file_store: Store, tmp_path: Path) -> None:
    yard = Yard(file_store, tmp_path)
    create_fleet(file_store, FLEET)
    version = yard.publish({"run.sh": STAYS_UP})
    run(yard, PuppetRobots(yard.store, 1), yard.request(version, "one"), version.digest)
    told = [_simyard(yard.store, "sync", FLEET, "--token", token) for token in ("mine", "mine", "other")]
    lines = [each.stdout.splitlines() for each in told]
    assert [each.exit_code for each in told] == [0, 0, 0]
    assert lines[0][0] == f"all robots of {FLEET} are in sync"
    assert lines[0][1].startswith("Succeeded arn:simyard:deployment-job:")
    assert lines[0] == lines[1] != lines[2]
    with pytest.raises(DocumentError, match="clientRequestToken"):
        _simyard(yard.store, "sync", FLEET, "--token", "a b")


def test_robots_and_fleets_leave_as_they_came(file_store: Store) -> None:
    create_fleet(file_store, "couriers")
    for robot in ("r1", "r2"):
        _simyard(file_store, "register", "couriers", robot)
    assert _simyard(file_store, "deregister", "r1").output == "r1 is in no fleet now\n"
    assert _simyard(file_store, "delete", "couriers").output == "couriers is deleted; in no fleet now: r2\n"
    assert _simyard(file_store, "delete-robot", "r2").output == "r2 is deleted\n"
    assert [robot.name for robot in robots(file_store)] == ["r1"]
    assert fleets(file_store) == []


def test_a_robot_has_the_architecture_it_was_made_with(file_store: Store) -> None:
    create_fleet(file_store, "couriers")
    _simyard(file_store, "register", "couriers", "arm", "--architecture", "ARM64")
    _simyard(file_store, "register", "couriers", "arm")
    with pytest.raises(DocumentError, match="arm, of architecture ARM64"):
        _simyard(file_store, "register", "couriers", "arm", "--architecture", "ARMHF")

    assert [robot.architecture for robot in robots(file_store)] == ["ARM64"]


def test_the_agents_help_lists_the_agents_options() -> None:
    told = CliRunner().invoke(app, ["agent", "--help"])
    assert told.exit_code == 0
    assert "--root-of-trust" in told.output
