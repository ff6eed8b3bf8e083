"""Lanes that cannot begin, each with its own reason; no ROS is needed for nodes that are never started."""

import errno
import os
import struct
import subprocess
from pathlib import Path

import pytest

from specs.errors import LaunchRefused
from tasks.ros.launch.launch_plan import LaunchPlan, LaunchSource, NodePlan
from tasks.ros.lockstep import ros1_lockstep
from tasks.ros.lockstep.exchange import ExchangeTotals, Launch
from tasks.ros.lockstep.ros1_lockstep import Ros1Lockstep
from tasks.ros.message.ros_messages import text_bytes
from tasks.ros.process import nap_gate
from tasks.ros.process.application_processes import ApplicationProcesses
from tasks.simulate.sandbox.confinement import Place, confined_command, confinement
from tasks.simulate.sandbox.process_environment import process_environment
from tests.repository import ROOT
from tests.ros.lockstep.room import BASE, CONTROL_S, Room, nothing_left

NODE = NodePlan("/node", "x", "x", ("sleep", "600"))


def begin(monkeypatch: pytest.MonkeyPatch, home: Path, *plans: LaunchPlan) -> dict[int, str]:
    monkeypatch.setattr(ros1_lockstep, "resolve_launch", lambda _source, _environments: list(plans))
    launch = Launch(home.parent, "x", "x.launch", home, [{}] * len(plans))
    with Ros1Lockstep(launch, BASE, CONTROL_S) as lockstep:
        lockstep.begin([Room(0).sense()] * len(plans), [None] * len(plans))
        found = dict(lockstep.failures)
    assert nothing_left(home)
    return found


def test_what_cannot_be_set_or_started_fails_its_own_lane(monkeypatch: pytest.MonkeyPatch, home: Path) -> None:
    number = LaunchPlan("x", (NODE,), {"/size": 2**40})
    nothing = LaunchPlan("x", (NODE,), {"/none": None})
    variable = LaunchPlan("x", (NODE._replace(environment=(("A=B", "1"),)),), {})
    text = LaunchPlan("x", (NODE._replace(command=("echo", "a\0b")),), {})
    found = begin(monkeypatch, home, number, nothing, variable, text)
    assert "a parameter of its launch file: /size: 1099511627776" in found[0]
    assert "a parameter of its launch file: /none: NoneType" in found[1]
    assert found[2] == "a node cannot be started: illegal environment variable name"
    assert found[3] == "a node cannot be started: embedded null byte"


def test_a_machine_without_room_is_no_fault_of_the_application(monkeypatch: pytest.MonkeyPatch, home: Path) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.EAGAIN, "no more processes")

    monkeypatch.setattr(ApplicationProcesses, "start", full)
    with pytest.raises(OSError, match="no more processes"):
        begin(monkeypatch, home, LaunchPlan("x", (NODE,), {}))


def test_a_kernel_that_does_not_count_runs_is_refused(monkeypatch: pytest.MonkeyPatch, home: Path) -> None:
    monkeypatch.setattr(ros1_lockstep, "counts_runs", lambda: False)
    with pytest.raises(LaunchRefused, match="schedstat"):
        begin(monkeypatch, home, LaunchPlan("x", (NODE,), {}))


def test_a_kernel_that_does_not_tell_of_connections_is_refused(monkeypatch: pytest.MonkeyPatch, home: Path) -> None:
    monkeypatch.setattr(ros1_lockstep, "counts_bytes", lambda: False)
    with pytest.raises(LaunchRefused, match="sock_diag"):
        begin(monkeypatch, home, LaunchPlan("x", (NODE,), {}))


def test_a_robot_that_is_set_elsewhere_between_two_control_steps_is_stray(home: Path) -> None:
    """Its application was taken for quiet: whoever sets it goes by the wall's clock."""
    source, pose = LaunchSource(home.parent, "x", "x.launch"), struct.pack("<7d", 1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    with Ros1Lockstep(Launch(*source[:3], home, [{}], source), BASE, CONTROL_S) as lockstep:
        lockstep._lane(0, LaunchPlan("x", (), {}, model="rover"))
        lockstep._gazebo[0].set_state(text_bytes("rover") + pose + bytes(48) + text_bytes(""))
        for _ in range(3):
            lockstep.exchange([Room(0).sense()])
        assert lockstep.tally(0) == ExchangeTotals(stray=1)


def test_the_output_says_where_no_naps_can_be_held(monkeypatch: pytest.MonkeyPatch, home: Path) -> None:
    monkeypatch.setattr(nap_gate, "_LEAST_LINUX", (99, 0))
    with Ros1Lockstep(Launch(home.parent, "x", "x.launch", home, [{}]), BASE, CONTROL_S) as lockstep:
        lockstep._lane(0, LaunchPlan("x", (), {}))
        assert "threads of its nodes may race" in lockstep.printed(0)


PROGRAM = """
import sys, tempfile
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from tasks.ros.lockstep.exchange import Launch
from tests.ros.lockstep.room import drive
home = Path(tempfile.mkdtemp()) / "home"
environment = [{"KIND": kind} for kind in ("none", "port", "port")]
found = drive(Launch(Path(sys.argv[1]), "courier", "fault.launch", home, environment), [0, 0, 0], 20)
print(sorted(found.failures), len(set(found.digests)), [tuple(tally) for tally in found.tallies], home.exists())
"""


@pytest.mark.long
@pytest.mark.skipif(
    confinement().level != "bubblewrap" and os.environ.get("CI") != "true", reason=confinement().why or "there"
)
def test_lanes_are_driven_in_bubblewrap_each_in_a_network_of_its_own(courier: Path, tmp_path: Path) -> None:
    programs = tmp_path / "programs"
    programs.mkdir()
    (programs / "program.py").write_text(PROGRAM)
    place = Place(programs, tmp_path)
    folders = [courier, ROOT / "tests", ROOT / "tasks", ROOT / "specs"]
    command = confined_command("program", [str(courier), str(ROOT)], place, folders)
    environment = process_environment(os.environ, programs) | place.variables()
    environment["PYTHONPATH"] += f"{os.pathsep}{programs}"
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.stdout == "[] 1 [(20, 0, 0, None), (20, 0, 0, None), (20, 0, 0, None)] False\n", done.stderr[-2000:]
