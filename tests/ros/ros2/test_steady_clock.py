"""The steady clock of C++ nodes, in a program of C++ and in nodes of rclpy that load what stands for rclcpp."""

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from specs.ros_robot import RosRobot
from tasks.ros.lockstep.exchange import Launch
from tasks.ros.lockstep.ros2_lockstep import Ros2Lockstep
from tasks.ros.lockstep.step_driver import LockstepPatience
from tasks.ros.ros2 import steady_clock
from tasks.ros.ros2.steady_clock import NO_COMPILER, build_steady_clock, with_steady_clock
from tests.repository import ROOT
from tests.ros.ros2 import players
from tests.ros.ros2.players import CONTROL_S, Run, compiled, make_base, make_rclcpp

_SOURCES, _TRIALS = ROOT / "tests/data/ros2/steady", ROOT / "tests/data/rclpy/trials"
_LIMIT_S = 60.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program that waits, the libraries that it has, and the one that is preloaded."""
    found = tmp_path_factory.mktemp("steady")
    rclcpp = make_rclcpp(found / "rclcpp") / "lib"
    compiled("cc", found / "librcl.so", "-shared", "-fPIC", f"{_SOURCES}/rcl.c")
    compiled("c++", found / "libfast_stand_in.so", "-shared", "-fPIC", f"{_SOURCES}/middleware.cpp")
    libraries = ["-Wl,--no-as-needed", f"-L{rclcpp}", f"-L{found}", "-lrclcpp", "-lrcl", "-lfast_stand_in"]
    compiled(
        "c++",
        found / "waits",
        "-std=c++17",
        f"{_SOURCES}/waits.cpp",
        *libraries,
        "-pthread",
        f"-Wl,-rpath,{found}:{rclcpp}",
    )
    assert build_steady_clock(found) == ""
    return found


def waited(folder: Path, kind: str, *told: str) -> str:
    """Returns what the program was told last when it had waited for 70 ms, and how much its steady clock went on."""
    environment = {**os.environ, "LD_PRELOAD": str(folder / "steady_clock.so")}
    command = [folder / "waits", kind, *told]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=_LIMIT_S, check=True)
    return done.stdout.strip()


_OF_SYSTEM = ("system", "system_condition", "system_future")
_WAITS = ("sleep_for", "sleep_until", "usleep", "sleep_after_publishing", "condition", "future", *_OF_SYSTEM)


@pytest.mark.parametrize("kind", _WAITS)
def test_who_waits_for_a_time_has_waited_when_simulated_time_comes(folder: Path, kind: str) -> None:
    assert waited(folder, kind, "1000", "1050", "1069", "1070", "1100") == "1070 70"


@pytest.mark.parametrize("kind", ["notified", "fulfilled"])
def test_who_waits_until_something_happens_has_waited_when_it_does(folder: Path, kind: str) -> None:
    assert waited(folder, kind, "1050", "1100") == "1050 50"


@pytest.mark.parametrize("kind", ["sleep_for", "usleep", "sleep_after_parameters"])
def test_who_sleeps_while_nodes_start_sleeps_by_the_machines_clock(folder: Path, kind: str) -> None:
    """And steady time stands, so that what begins meanwhile begins at the same time on each machine."""
    assert waited(folder, kind) == "never 0"


def test_who_waits_for_a_lock_waits_so_long_by_the_machines_clock(folder: Path) -> None:
    assert waited(folder, "lock") == "never 0"


def test_who_waits_for_a_time_that_was_read_before_it_follows_simulated_time_is_not_left_behind(folder: Path) -> None:
    """As threads of spdlog do, which rcl has."""
    assert waited(folder, "early") == "never 0"


def test_the_middleware_has_the_machines_clock(folder: Path) -> None:
    assert waited(folder, "middleware") == "1 never 0"


def test_steady_time_goes_on_when_each_clock_of_a_process_has_heard_of_it(folder: Path) -> None:
    assert waited(folder, "sleep_for", "1000", "1050", "1070a", "1070", "1100") == "1070 70"


def test_a_clock_that_missed_a_tick_is_not_waited_for(folder: Path) -> None:
    """As of a node that is gone."""
    assert waited(folder, "sleep_for", "1000", "1050", "1060a", "1070a", "1100") == "1070a 70"


def test_without_rclcpp_a_process_has_the_machines_clock(folder: Path) -> None:
    program = "import time; begun = time.monotonic(); time.sleep(0.01); print(time.monotonic() - begun >= 0.01)"
    environment = {**os.environ, "LD_PRELOAD": str(folder / "steady_clock.so")}
    command = ["python3", "-c", program]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=_LIMIT_S, check=True)
    assert (done.stdout, done.stderr) == ("True\n", "")


def test_a_library_of_the_users_own_is_preloaded_as_well(folder: Path, tmp_path: Path) -> None:
    found = with_steady_clock(folder, tmp_path, {"LD_PRELOAD": "libown.so", "SPEED": "1"})
    assert found == {"LD_PRELOAD": f"{tmp_path}/steady_clock.so libown.so", "SPEED": "1"}
    assert with_steady_clock(tmp_path / "none", tmp_path, {"SPEED": "1"}) == {"SPEED": "1"}


def test_the_library_of_nodes_that_run_is_not_written_again(folder: Path, tmp_path: Path) -> None:
    """Of two applications the second one is started while nodes of the first one load it."""
    with_steady_clock(folder, tmp_path, {})
    before = (tmp_path / "steady_clock.so").stat()
    with_steady_clock(folder, tmp_path, {})
    assert (tmp_path / "steady_clock.so").stat().st_mtime_ns == before.st_mtime_ns


def test_it_asks_for_no_version_of_the_c_library(folder: Path) -> None:
    """An image's may be older than this machine's."""
    assert b"GLIBC_2.3.2" in (library := (folder / "steady_clock.so").read_bytes())  # it looks for this one by name
    assert library.count(b"GLIBC_") == 1
    assert b"libc.so.6" not in library


def test_why_it_cannot_be_made_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(steady_clock, "c_compiler", lambda: "/bin/false")
    assert build_steady_clock(tmp_path).startswith(
        "wall timers of rclcpp go by the machine's clock, for /bin/false fails"
    )
    monkeypatch.setattr(steady_clock, "c_compiler", str)
    assert build_steady_clock(tmp_path) == NO_COMPILER


@pytest.mark.long
def test_a_node_that_is_not_ready_for_want_of_a_compiler_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("lib/librclcpp.so", "lib/librmw_cyclonedds_cpp.so", "share/ament_index/resource_index/one"):
        (tmp_path / "ros" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "ros" / name).touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ros"))
    monkeypatch.setattr(steady_clock, "c_compiler", str)
    run = players.drive(tmp_path / "run", "hurried", steps=1, robot=RosRobot(ready_s=15.0))
    assert run.failures[0].startswith("not ready within 15 s")
    assert run.failures[0].endswith(f" commands; {NO_COMPILER}")


Drive = Callable[[str, int], Run]


@pytest.fixture
def drive(rclpy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Drive:
    """Drives episodes with a node of the trials, beside what stands for rclcpp."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{make_rclcpp(tmp_path / 'rclcpp')}:{rclpy}")

    def run(nodes: str, lanes: int) -> Run:
        home = tmp_path / f"{nodes}-{lanes}"
        shutil.copytree(_TRIALS, home / "bundle/trials")
        environment = {"NODES": nodes, "SPEED": "0.2"}
        launch = Launch(home / "bundle", "trials", "trials.launch.py", home / "home", [environment] * lanes)
        with Ros2Lockstep(launch, make_base(), CONTROL_S, patience=LockstepPatience(stage_s=20.0)) as lockstep:
            return Run(lockstep, lanes, 30)

    return run


@pytest.mark.long
@pytest.mark.parametrize("node", ["walltimer", "looker", "turns"])
def test_a_node_that_goes_by_rcls_steady_clock_gives_the_same_row_alone_and_among_four(drive: Drive, node: str) -> None:
    """By a timer of it, an executor that waits so long at most, and two threads that sleep until the same tick."""
    runs = [drive(node, lanes) for lanes in (1, 4)]
    assert [run.failures for run in runs] == [{}, {}]
    assert {run.digests[0] for run in runs} == {runs[0].digests[0]}
    assert not any(each.late or each.stray for run in runs for each in run.tallies)
    assert len(set(runs[0].commands[0])) > 20, "it counts in simulated time"
