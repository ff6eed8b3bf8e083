"""Nodes that play ROS 2's, in lock-step with their episodes."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_typestore

from specs.ros_robot import RosRobot
from tasks.ros.lockstep.exchange import TwistCommand
from tasks.ros.lockstep.robot_topics import SensorMessages
from tasks.ros.lockstep.ros2_lockstep import DdsGraph
from tasks.ros.lockstep.sensor_topics import Moment
from tasks.ros.lockstep.step_driver import LockstepPatience
from tasks.ros.ros2.datagrams import DropWatch, UdpSocket
from tasks.ros.ros2.dds_domain import DOMAINS
from tests.data.ros2.avoidance import steer
from tests.ros.ros2.players import CONTROL_S, ToyWorld, drive, make_base
from tests.servers.eventually import eventually

_BURN = "while True: pass"
# Whoever is never ready takes all of it, and has to be heard within it, also on a machine that others use.
_READY_S = 15.0


def test_a_scan_is_answered_in_its_own_control_step_as_ros_1s_bytes_would_be(tmp_path: Path) -> None:
    """The same steering, given what a node of ROS 1 reads, says the same to the last bit."""
    run = drive(tmp_path, "avoider", steps=20)
    assert run.failures == {}
    assert (run.tallies[0].commands, run.tallies[0].late, run.tallies[0].stray) == (20, 0, 0)
    store, messages, world = get_typestore(Stores.ROS1_NOETIC), SensorMessages(make_base(), CONTROL_S), ToyWorld(0)
    for step, command in enumerate(run.commands[0]):
        ros1 = messages.write("/scan", Moment(step, 1_000_000_000, world.sense()))
        scan = store.deserialize_ros1(ros1, "sensor_msgs/msg/LaserScan")
        ranges = [float(each) for each in scan.ranges]  # type: ignore[attr-defined]
        ahead, turn = steer(float(scan.angle_min), float(scan.angle_increment), ranges)  # type: ignore[attr-defined]
        assert command == TwistCommand(ahead, 0.0, turn)
        world.drive(command)


def test_a_callback_that_waits_on_a_condition_until_its_time_is_over_answers_in_its_own_control_step(
    tmp_path: Path,
) -> None:
    """As ``rclcpp::sleep_for`` does, and a wait of ``threading`` with a limit."""
    run, at_once = (drive(tmp_path / each, each, steps=20) for each in ("waiter", "avoider"))
    assert run.failures == {}
    assert (run.tallies[0].commands, run.tallies[0].late, run.tallies[0].stray) == (20, 0, 0)
    assert run.commands == at_once.commands


@pytest.mark.long
def test_a_node_that_commands_by_the_walls_clock_is_not_ready_for_that_reason(tmp_path: Path) -> None:
    run = drive(tmp_path, "hurried", steps=1, robot=RosRobot(ready_s=_READY_S))
    assert run.failures[0].startswith("not ready within 15 s: its nodes did not come to rest")
    assert "they publish /cmd_vel by the wall's clock: " in run.failures[0]


@pytest.mark.long
def test_a_node_that_commands_best_effort_is_not_ready_for_that_reason(tmp_path: Path) -> None:
    run = drive(tmp_path, "weak", steps=1, robot=RosRobot(ready_s=_READY_S))
    why = "publishes /cmd_vel best effort: the robot hears who is reliable alone: publish it with"
    assert f"not ready within 15 s: /player {why} ReliabilityPolicy.RELIABLE" in run.failures[0]


def test_nothing_is_left_of_an_episode(tmp_path: Path) -> None:
    threads = {*Path("/proc/self/task").iterdir()}
    drive(tmp_path, "avoider", steps=1)
    assert not (tmp_path / "home").exists()
    eventually(lambda: threads.issuperset(Path("/proc/self/task").iterdir()))  # a thread takes a while to be cleared up
    marked = f"ROS_HOME={tmp_path}".encode()
    assert not [each for each in Path("/proc").glob("[0-9]*/environ") if marked in _read(each)]


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""


def test_an_episode_whose_nodes_may_not_know_each_other_is_late_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(DdsGraph, "guessed", property(lambda _: True))
    run = drive(tmp_path, "avoider", steps=3)
    assert (run.failures, run.tallies[0].late) == ({}, 1)


def test_datagrams_that_are_dropped_within_a_control_step_count_as_late(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lost = {number: UdpSocket(7411 + 250 * number, 2) for number in DOMAINS}
    monkeypatch.setattr(DropWatch, "look", lambda _: lost)
    run = drive(tmp_path, "avoider", steps=3)
    assert (run.failures, run.tallies[0].late, run.tallies[0].stray) == ({}, 6, 0)


def test_a_launch_file_that_is_refused_fails_its_lane_and_says_why(tmp_path: Path) -> None:
    run = drive(tmp_path, "pilot", steps=1)
    assert "play play.launch.py: the package play has no executable 'pilot'" in run.failures[0]
    assert run.commands[0] == [TwistCommand()]


@pytest.mark.long
def test_a_job_is_tagged_and_cancelled_by_its_application(tmp_path: Path) -> None:
    run = drive(tmp_path, "service_caller", steps=20)
    assert run.failures == {}
    assert run.tags == {"room": "kitchen"}
    assert run.cancelled == {0}


@pytest.mark.long
def test_a_simulation_applications_nodes_judge_beside_the_robots_and_gazebo_is_not_started(tmp_path: Path) -> None:
    run = drive(tmp_path, "avoider", steps=20, judged=True)
    assert run.failures == {}
    assert (run.tags, run.cancelled) == ({"room": "kitchen"}, {0})
    assert run.tallies[0].stray == 0


@pytest.mark.long
def test_a_node_that_ends_fails_its_lane_and_leaves_its_neighbour_alone(tmp_path: Path) -> None:
    alone = drive(tmp_path / "alone", "avoider", lanes=2, steps=30)
    run = drive(tmp_path / "both", ["faulty", "avoider"], lanes=2, steps=30)
    assert "node /player ended with status 1" in run.failures[0]
    assert "the lidar is on fire" in run.failures[0]
    assert run.digests[1] == alone.digests[1]
    assert (run.tallies[1].late, run.tallies[1].stray) == (0, 0)


def test_a_node_that_ends_well_without_a_farewell_fails_its_lane_in_that_control_step(tmp_path: Path) -> None:
    """DDS has it for 10 s of wall time more, in which its robot would drive on."""
    run = drive(tmp_path, "leaver", steps=30)
    assert run.failures[0].startswith("node /player ended with status 0, and no node is connected to the command topic")
    assert (run.tallies[0].commands < 6, run.tallies[0].late, run.tallies[0].stray) == (True, 0, 0)


@pytest.mark.long
def test_nodes_that_talk_to_each_other_give_the_same_row_however_long_each_waits_for_a_core(tmp_path: Path) -> None:
    """Told at the same time, one would have the other's advice sometimes before it sees the walls, sometimes not."""
    runs = [drive(tmp_path / str(k), "advised+adviser", lanes=lanes, steps=25) for k, lanes in enumerate((1, 1, 4))]
    assert [run.failures for run in runs] == [{}, {}, {}]
    assert {run.digests[0] for run in runs} == {runs[0].digests[0]}
    assert not any(each.late or each.stray for run in runs for each in run.tallies)
    assert any(each.ahead_m_s for each in runs[0].commands[0])


@pytest.mark.long
def test_ten_repeats_alone_and_among_eight_and_with_burners_are_the_same(tmp_path: Path) -> None:
    # More than the default: beside other work several threads wait for a core one after the other.
    patient = partial(drive, patience=LockstepPatience(stage_s=6.0))
    programs = ["avoider", "timed"]
    burners = [subprocess.Popen([sys.executable, "-c", _BURN]) for _ in range(os.cpu_count() or 1)]
    try:
        busy = patient(tmp_path / "busy", programs, lanes=2, steps=20)
    finally:
        for each in burners:
            each.kill()
            each.wait()
    among = [patient(tmp_path / f"among-{k}", 4 * programs, lanes=8, steps=20) for k in range(3)]
    again = [patient(tmp_path / f"again-{k}", programs, lanes=2, steps=20) for k in range(3)]
    alone = [patient(tmp_path / f"alone-{k}", "avoider", steps=20) for k in range(3)]
    assert {tuple(run.digests[:2]) for run in (busy, *among, *again)} == {tuple(busy.digests)}
    assert {run.digests[0] for run in alone} == {busy.digests[0]}
    assert {tuple(run.digests) for run in among} == {tuple(among[0].digests)}
    assert len(set(among[0].digests)) == 8
    assert not any(each.late or each.stray for run in (busy, *among, *again, *alone) for each in run.tallies)
    assert all(each.ahead_m_s or each.turn_rad_s for each in among[0].commands[0])
