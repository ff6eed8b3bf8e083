"""Applications that misbehave, each in a lane beside one that does not."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from specs.ros_robot import RosRobot
from tasks.ros.lockstep.exchange import ExchangeTotals, Launch
from tasks.ros.lockstep.step_driver import LockstepPatience
from tasks.ros.process.lane_limits import LaneLimits
from tests.repository import ROOT
from tests.ros.lockstep.room import Driven, drive, nothing_left
from tests.servers.open_files import open_files

STEPS = 40
LIMITS = LaneLimits(memory_bytes=300 << 20, written_bytes=32 << 20, processes=40)
FAULTS = {
    "crash": "node /fault ended with status 7",
    "done": "no node is connected to the command topic any more",
    "hang": "did not come to rest within 2 s, 1 times: /fault, thread ",
    "flood": "commands came",
    "nan": "/cmd_vel: a command is not a number: (nan, 0.0, 0.0)",
    "stop": "node /fault was stopped by a signal",
    "sockets": "",
    "memory": "MiB of memory: more than the 300 MiB",
    "files": "MiB of files and logs: more than the 32 MiB",
    "forks": "processes: more than the 40",
}
SOUND = ("none", "nap", "orphan", "port", "port")
KINDS = (*SOUND, *FAULTS)


def run(bundle: Path, home: Path, kinds: tuple[str, ...]) -> Driven:
    environment = [{"KIND": kind} for kind in kinds]
    launch = Launch(bundle, "courier", "fault.launch", home, environment)
    return drive(
        launch, [0] * len(kinds), STEPS, patience=LockstepPatience(stage_s=2.0, nap_s=0.2, late_limit=1), limits=LIMITS
    )


@pytest.mark.long
def test_each_fault_is_a_reason_of_its_own_lane_and_its_neighbours_keep_their_bits(courier: Path, home: Path) -> None:
    before = open_files()
    alone, all_of_them = run(courier, home, ("none",)), run(courier, home, KINDS)
    assert nothing_left(home)
    assert open_files() <= before  # what others held in this process may be closed by now
    found = dict(
        zip(KINDS[len(SOUND) :], (all_of_them.failures.get(k, "") for k in range(len(SOUND), 15)), strict=True)
    )
    assert [kind for kind, words in FAULTS.items() if not found[kind] or words not in found[kind]] == []
    assert sorted(all_of_them.failures) == list(range(len(SOUND), len(KINDS)))
    assert set(all_of_them.digests[: len(SOUND)]) == set(alone.digests)
    assert {(tally.late, tally.stray) for tally in all_of_them.tallies[: len(SOUND)]} == {(0, 0)}


@pytest.mark.long
def test_a_launch_file_that_is_refused_fails_each_lane_with_roslaunchs_words(courier: Path, home: Path) -> None:
    found = drive(Launch(courier, "courier", "fault.launch", home, [{}, {"KIND": "none"}]), [0, 0], 1)
    assert found.failures == {0: "courier fault.launch: environment variable 'KIND' is not set"}


@pytest.mark.long
def test_a_required_node_that_is_done_ends_its_episode(courier: Path, home: Path) -> None:
    environment = [{"KIND": "done", "REQUIRED": "true"}]
    found = drive(Launch(courier, "courier", "fault.launch", home, environment), [0], STEPS)
    assert "/fault" in found.failures[0]


@pytest.mark.long
def test_a_robot_may_stand_until_its_first_command_and_what_it_waited_for_is_named(courier: Path, home: Path) -> None:
    environment = [{"AFTER": "2.0"}, {"TOPIC": "/base/cmd_vel"}, {"AFTER": "60.0"}]
    launch = Launch(courier, "courier", "late.launch", home, environment)
    found = drive(launch, [0, 0, 0], STEPS, robot=RosRobot(first_command_s=1.8))
    why = "no node publishes /cmd_vel within 1.8 simulated s (first_command_s in ros.yaml)"
    elsewhere = "/late publishes geometry_msgs/Twist on /base/cmd_vel, to which nobody subscribes"
    assert found.failures == {1: f"{why}; {elsewhere}", 2: why}
    assert found.printed == ["", elsewhere, ""]
    assert found.tallies[0].commands > 0


@pytest.mark.long
def test_a_node_that_sleeps_by_the_walls_clock_before_it_advertises_is_waited_for(courier: Path, home: Path) -> None:
    environment = [{"AFTER": "4.0", "CLOCK": "wall"}]
    found = drive(Launch(courier, "courier", "late.launch", home, environment), [0], 10)
    assert found.failures == {}
    assert found.tallies == [ExchangeTotals(5, 0, 0)]


@pytest.mark.parametrize("nodes", [pytest.param(6, marks=pytest.mark.long), pytest.param(32, marks=pytest.mark.soak)])
def test_no_node_survives_the_process_that_holds_it(courier: Path, tmp_path: Path, nodes: int) -> None:
    home = tmp_path / "home"
    program = (
        "import sys, time\nfrom pathlib import Path\n"
        "from tasks.ros.lockstep.exchange import Launch\nfrom tasks.ros.lockstep.ros1_lockstep import Ros1Lockstep\n"
        "from tests.ros.lockstep.room import BASE, CONTROL_S, Room\n"
        "bundle, home, count = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])\n"
        "launch = Launch(bundle, 'courier', 'fault.launch', home, [{'KIND': 'orphan'}] * count)\n"
        "lockstep = Ros1Lockstep(launch, BASE, CONTROL_S)\n"
        "lockstep.begin([Room(0).sense()] * count, [None] * count)\n"
        "print(len(lockstep.failures), flush=True); time.sleep(600)"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", program, str(courier), str(home), str(nodes)]
    holder = subprocess.Popen(command, stdout=subprocess.PIPE, env=environment)
    assert holder.stdout is not None
    assert holder.stdout.readline() == b"0\n"
    assert not nothing_left(home)
    holder.send_signal(signal.SIGKILL)
    holder.communicate()
    while not nothing_left(home):
        time.sleep(0.02)


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_two_hundred_faulty_episodes_leave_nothing(courier: Path, home: Path) -> None:
    before = open_files()
    for _ in range(200 // len(FAULTS)):
        assert len(run(courier, home, tuple(FAULTS)).failures) == len(FAULTS)
        assert nothing_left(home)
    assert open_files() <= before  # what others held in this process may be closed by now
