"""Goals as actions of ROS 1's move_base: their messages, and what comes of them in lock-step."""

import struct
from pathlib import Path

import pytest

from tasks.ros.lockstep.exchange import GoalEnd, Launch
from tasks.ros.lockstep.step_driver import LockstepPatience
from tasks.ros.message.definition import definition
from tasks.ros.message.navigation import MOVE_BASE_KIND, MOVE_BASE_RESULT_KIND, Navigation
from tasks.ros.message.ros_messages import Stamp, pose_stamped, text_bytes
from tests.ros.lockstep.room import BASE, Driven, drive

_PATIENCE = LockstepPatience(stage_s=20.0)
_TYPES = {kind.split("/")[1]: definition(kind) for kind in (MOVE_BASE_KIND, MOVE_BASE_RESULT_KIND)}
_POSE = pose_stamped(7, Stamp(3, 5), "map", (1.0, 2.0, 0.0))


def result(goal: str, status: int) -> bytes:
    head = struct.pack("<III", 1, 4, 0) + text_bytes("")
    return head + bytes(8) + text_bytes(goal) + bytes([status]) + text_bytes("done")


@pytest.mark.parametrize(
    ("goal", "number", "status"),
    [
        ("simyard-1", 3, "succeeded"),
        ("simyard-1", 2, "canceled"),
        ("simyard-1", 4, "aborted"),
        ("simyard-1", 5, "rejected"),
        ("simyard-1", 8, "canceled"),
        ("simyard-1", 9, "aborted"),
        ("somebody-elses", 4, "asked"),
    ],
)
def test_a_result_ends_the_goal_that_it_names(goal: str, number: int, status: str) -> None:
    navigation = Navigation()
    assert _POSE in navigation.ask(_POSE)
    navigation.hear(result(goal, number))
    assert navigation.status == status


@pytest.mark.parametrize("end", [3, 20, 33])
def test_a_result_that_is_cut_off_is_none(end: int) -> None:
    with pytest.raises(ValueError, match="bytes"):
        Navigation().hear(result("simyard-1", 3)[:end])


def navigate(courier: Path, home: Path, *plays: str) -> Driven:
    launch = Launch(courier, "courier", "navigate.launch", home, [{"PLAYS": each, **_TYPES} for each in plays])
    robot = BASE.robot.model_copy(update={"goals": "move_base", "first_command_s": 2.0})
    return drive(launch, [0] * len(plays), 160, patience=_PATIENCE, robot=robot)


@pytest.mark.long
def test_goals_go_to_move_base_as_actions_and_each_lane_has_its_own_end(courier: Path, home: Path) -> None:
    found = navigate(courier, home, "", "late", "cancels", "aborts", "rejects", "never")
    assert found.failures == {
        5: "no node offers the action /move_base (goals in ros.yaml) within 2 simulated s (first_command_s in ros.yaml)"
    }
    assert found.goal_ends == {2: GoalEnd("canceled", 0), 3: GoalEnd("aborted", 0), 4: GoalEnd("aborted", 0)}
    assert ["ended with 3" in each for each in found.printed] == [True, True, False, False, False, False]
    assert found.printed[4].count("goal simyard-") == 3, "one that is rejected is sent again each second"
    assert {(each.late, each.stray) for each in found.tallies} == {(0, 0)}
    assert navigate(courier, home, "").digests == found.digests[:1]
