"""Fleets and robots go away, and leave nothing half there."""

import pytest

from specs.errors import ConcurrentDeployment, ResourceNotFound, StageFailed
from tasks.deploy.fleet.fleet_registry import (
    change_fleet,
    create_fleet,
    create_robot,
    fleets,
    read_desired,
    read_robot,
    register_robot,
    robots,
)
from tasks.deploy.fleet.reservation import delete_fleet, delete_robot
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard


def test_robots_of_a_deleted_fleet_are_free_for_another(yard: Yard) -> None:
    PuppetRobots(yard.store, 2)
    assert delete_fleet(yard.store, FLEET) == ("r0", "r1")
    assert fleets(yard.store) == []
    assert [robot.fleet for robot in robots(yard.store)] == ["", ""]
    create_fleet(yard.store, "cleaners")
    assert register_robot(yard.store, "cleaners", "r0").fleet == "cleaners"


def test_a_fleet_in_the_middle_of_a_deployment_is_not_deleted(yard: Yard) -> None:
    puppets, version = PuppetRobots(yard.store, 3), yard.publish({"run.sh": STAYS_UP})
    puppets.dies_after = 0
    with pytest.raises(StageFailed):
        run(yard, puppets, yard.request(version, "one"), version.digest)
    with pytest.raises(ConcurrentDeployment):
        delete_fleet(yard.store, FLEET)


def test_a_robot_deleted_in_the_middle_of_a_deployment_does_not_answer_and_the_others_go_on(yard: Yard) -> None:
    puppets, version = PuppetRobots(yard.store, 3, step_s=10_000.0), yard.publish({"run.sh": STAYS_UP})
    puppets.silent = {"r1"}

    def delete(ended: int, _robots: int) -> None:
        if ended == 1:
            delete_robot(yard.store, "r1")

    record = run(yard, puppets, yard.request(version, "one"), version.digest, delete)
    assert record.status == "Succeeded"
    with pytest.raises(ResourceNotFound):
        read_robot(yard.store, "r1")


def test_a_robot_that_comes_back_by_its_old_name_is_asked_with_a_higher_sequence(yard: Yard) -> None:
    puppets, version = PuppetRobots(yard.store, 1), yard.publish({"run.sh": STAYS_UP})
    run(yard, puppets, yard.request(version, "one"), version.digest)
    before = puppets.asked()[0].sequence
    assert delete_robot(yard.store, "r0") == "r0"
    create_robot(yard.store, "r0")
    register_robot(yard.store, FLEET, "r0")
    run(yard, puppets, yard.request(version, "two"), version.digest)
    desired, _ = read_desired(yard.store, "r0")
    assert desired
    assert desired.sequence > before


def test_a_deletion_that_was_killed_halfway_is_finished_by_the_next(
    yard: Yard, monkeypatch: pytest.MonkeyPatch
) -> None:
    PuppetRobots(yard.store, 2)

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("tasks.deploy.fleet.reservation.deregister_robot", killed)
        with pytest.raises(KeyboardInterrupt):
            delete_fleet(yard.store, FLEET)
    assert fleets(yard.store) == []
    with pytest.raises(ResourceNotFound, match="being deleted"):
        register_robot(yard.store, FLEET, "r0")
    assert delete_fleet(yard.store, FLEET) == ("r0", "r1")
    assert create_fleet(yard.store, FLEET).deployment == ""


def test_a_fleet_is_made_anew_while_the_old_one_is_being_deleted(yard: Yard) -> None:
    change_fleet(yard.store, FLEET, lambda fleet: fleet.model_copy(update={"deleted": True}))
    assert not create_fleet(yard.store, FLEET).deleted
    assert [fleet.name for fleet in fleets(yard.store)] == [FLEET]
