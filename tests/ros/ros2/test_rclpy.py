"""Nodes of ROS 2's own rclpy, on its default middleware, in lock-step with their episodes."""

import contextlib
import json
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from specs.ros_robot import RosRobot
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.ros.lockstep.exchange import Launch
from tasks.ros.lockstep.ros2_lockstep import Ros2Lockstep
from tasks.ros.lockstep.step_driver import LockstepPatience
from tasks.simulate.sandbox.launch_check import check_launch_file
from tests.repository import ROOT
from tests.ros.lockstep.room import nothing_left
from tests.ros.pictures import seeing
from tests.ros.random_graph import Part, part, random_graph
from tests.ros.ros2.players import CONTROL_S, Run, make_base
from tests.servers.open_files import open_files

_ROAMER, _TRIALS = ROOT / "examples/ros/roamer2", ROOT / "tests/data/rclpy/trials"
# Far more than a node takes, on a machine that does much else.
_PATIENT = LockstepPatience(stage_s=20.0)
_SHARED = Path("/dev/shm")  # noqa: S108 - where Fast DDS would have its memory


def drive(
    folder: Path,
    package: Path,
    file: str,
    nodes: str = "",
    lanes: int = 1,
    *,
    graph: str = "",
    robot: RosRobot | None = None,
) -> Run:
    """Returns what came of episodes with the nodes of a package."""
    folder.mkdir()
    shutil.copytree(package, folder / "bundle" / package.name)
    environment = {"NODES": nodes, "SPEED": "0.2", "GRAPH": graph}
    launch = Launch(folder / "bundle", package.name, file, folder / "home", [environment] * lanes)
    with Ros2Lockstep(launch, make_base(robot), CONTROL_S, patience=_PATIENT) as lockstep:
        return Run(lockstep, lanes, 30, robot=robot)


@pytest.mark.usefixtures("rclpy_that_is_here")
def test_two_nodes_of_rclpy_that_talk_by_a_service_drive_the_robot(tmp_path: Path) -> None:
    run = drive(tmp_path / "run", _ROAMER, "roam.launch.py")
    assert run.failures == {}
    assert (run.tallies[0].commands, run.tallies[0].late, run.tallies[0].stray) == (30, 0, 0)
    assert any(each.ahead_m_s for each in run.commands[0])


def _left_in_shared_memory(before: set[Path]) -> list[Path]:
    """Returns the segments of Fast DDS that nobody has open: a robot of another test, which runs now, has its own."""
    new = [each for each in set(_SHARED.iterdir()) - before if each.name.startswith(("fastdds", "fastrtps"))]
    held = set[str]()
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it has ended
            held.update(line.split()[-1] for line in (process / "maps").read_text().splitlines())
            for each in (process / "fd").iterdir():
                with contextlib.suppress(OSError):  # it was closed
                    held.add(str(each.readlink()))
    return [each for each in new if str(each) not in held and each.exists()]


@pytest.mark.long
@pytest.mark.usefixtures("rclpy")
@pytest.mark.parametrize("nodes", ["roam", "threads", "stamped", "counter asker"])
def test_the_same_row_comes_again_alone_and_among_four(tmp_path: Path, nodes: str) -> None:
    package, file = (_ROAMER, "roam.launch.py") if nodes == "roam" else (_TRIALS, "trials.launch.py")
    before = set(_SHARED.iterdir())
    runs = [drive(tmp_path / str(k), package, file, nodes, lanes) for k, lanes in enumerate((1, 4, 1))]
    assert [run.failures for run in runs] == [{}, {}, {}]
    assert {run.digests[0] for run in runs} == {runs[0].digests[0]}
    assert not any(each.late or each.stray for run in runs for each in run.tallies)
    assert any(each.ahead_m_s for each in runs[0].commands[0])
    # Nodes are killed, and leave nothing where they share memory.
    assert _left_in_shared_memory(before) == []


@pytest.mark.long
@pytest.mark.usefixtures("rclpy")
def test_a_node_that_drives_by_pictures_gives_the_same_row_alone_and_among_two(tmp_path: Path) -> None:
    robot = seeing()
    runs = [drive(tmp_path / str(k), _TRIALS, "trials.launch.py", "seer", k, robot=robot) for k in (1, 2)]
    assert [run.failures for run in runs] == [{}, {}]
    assert runs[0].digests[0] == runs[1].digests[0]
    # A picture at each second step, each answered.
    assert {(each.commands, each.late, each.stray) for run in runs for each in run.tallies} == {(15, 0, 0)}


def _drive_graph(folder: Path, graph: Mapping[str, Part], lanes: int) -> Run:
    nodes = " ".join(f"part:{name}" for name in graph)
    return drive(folder, _TRIALS, "trials.launch.py", nodes, lanes, graph=json.dumps(graph))


@pytest.mark.long
@pytest.mark.usefixtures("rclpy")
@pytest.mark.parametrize("seed", [100, 101])
def test_a_random_graph_gives_the_same_row_alone_and_among_two(tmp_path: Path, seed: int) -> None:
    runs = [_drive_graph(tmp_path / str(k), random_graph(seed), lanes) for k, lanes in enumerate((1, 2))]
    assert [run.failures for run in runs] == [{}, {}]
    # First, for it tells why commands differ, if any column does.
    assert [(each.late, each.stray) for run in runs for each in run.tallies] == [(0, 0)] * 3
    assert runs[0].digests[0] == runs[1].digests[0]
    assert any(each.ahead_m_s for each in runs[0].commands[0])


@pytest.mark.long
@pytest.mark.usefixtures("rclpy")
def test_nodes_that_ask_one_at_once_are_counted_as_late(tmp_path: Path) -> None:
    """Their commands differ from run to run, and so a column has to say it."""
    asks = part(reads="hop", writes="cmd_vel", asks="count")
    graph = {"first": part(reads="scan", writes="hop"), "left": asks, "right": asks, "answers": part(answers="count")}
    run = _drive_graph(tmp_path / "run", graph, 1)
    assert (run.failures, run.tallies[0].late, run.tallies[0].stray) == ({}, 30, 0)


# What the faulty node of the trials does, and how a row tells it.
_FAULTS = {
    "raise": "node /faulty ended with status 1",
    "exit": "node /faulty ended with status 7",
    "done": "node /faulty ended with status 0",
    "hang": "did not come to rest",
    "kill": "node /faulty was ended by SIGKILL",
    "abort": "node /faulty was ended by SIGABRT",
    "stop": "node /faulty was stopped by a signal",
    "child": "node /faulty ended with status 3",
}


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where this process writes temporary files."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def _fault(folder: Path, temporary: Path, kinds: Sequence[str]) -> Run:
    """Returns what came of an episode for each kind of fault, of which nothing is left."""
    before, open_before = set(_SHARED.iterdir()), open_files()
    shutil.copytree(_TRIALS, folder / "bundle/trials")
    environments = [{"NODES": "faulty", "FAULT": kind, "SPEED": "0.2"} for kind in kinds]
    launch = Launch(folder / "bundle", "trials", "trials.launch.py", folder / "home", environments)
    patience = LockstepPatience(stage_s=2.0, late_limit=1)
    with Ros2Lockstep(launch, make_base(), CONTROL_S, patience=patience) as lockstep:
        run = Run(lockstep, len(kinds), 34)
    assert nothing_left(folder / "home")
    assert _left_in_shared_memory(before) == []
    assert open_files() <= open_before
    assert list(temporary.iterdir()) == []
    shutil.rmtree(folder)
    return run


@pytest.mark.long
@pytest.mark.usefixtures("rclpy")
def test_each_fault_of_a_node_of_rclpy_is_its_own_episodes_reason_and_nothing_is_left(
    tmp_path: Path, temporary: Path
) -> None:
    run = _fault(tmp_path / "run", temporary, [*_FAULTS])
    assert [kind for k, (kind, said) in enumerate(_FAULTS.items()) if said not in run.failures.get(k, "")] == [], (
        run.failures
    )


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.usefixtures("rclpy")
def test_two_hundred_faulty_episodes_of_rclpy_leave_nothing(tmp_path: Path, temporary: Path) -> None:
    for k in range(200 // len(_FAULTS)):
        assert len(_fault(tmp_path / str(k), temporary, [*_FAULTS]).failures) == len(_FAULTS)


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.usefixtures("rclpy", "burners")
@pytest.mark.parametrize("seed", range(100, 120))
def test_random_graphs_give_the_same_row_in_any_number_of_lanes_beside_burners(tmp_path: Path, seed: int) -> None:
    runs = [_drive_graph(tmp_path / f"{lanes}-{k}", random_graph(seed), lanes) for lanes in (1, 4, 8) for k in range(3)]
    assert all(run.failures == {} for run in runs)
    assert {run.digests[0] for run in runs} == {runs[0].digests[0]}
    assert not any(each.late or each.stray for run in runs for each in run.tallies)


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.usefixtures("rclpy", "burners")
@pytest.mark.parametrize("lanes", [1, 4, 8])
@pytest.mark.parametrize("nodes", ["roam", "threads", "counter asker"])
def test_ten_repeats_beside_burners_give_the_same_rows(tmp_path: Path, nodes: str, lanes: int) -> None:
    package, file = (_ROAMER, "roam.launch.py") if nodes == "roam" else (_TRIALS, "trials.launch.py")
    runs = [drive(tmp_path / str(k), package, file, nodes, lanes) for k in range(10)]
    assert all(run.failures == {} for run in runs)
    assert {tuple(run.digests) for run in runs} == {tuple(runs[0].digests)}
    assert not any(each.late or each.stray for run in runs for each in run.tallies)


@pytest.mark.long
def test_what_is_here_and_what_is_missing_is_said_before_the_run(rclpy: Path, tmp_path: Path) -> None:
    shutil.copytree(_ROAMER, tmp_path / "roamer2")
    source = LaunchSource(tmp_path, "roamer2", "roam.launch.py")
    found = check_launch_file(source, [{}], own=True)
    assert (found.has_ros, found.missing, found.refusals, found.unread) == (True, (), (), "")
    assert found.nodes == ("/roam (roamer2 roam)", "/watch (roamer2 watch)")
    assert found.ros.startswith(f"ROS 2 jazzy below {rclpy}; nodes speak rmw_fastrtps_cpp")
    manifest = tmp_path / "roamer2/package.xml"
    manifest.write_text(manifest.read_text().replace("</license>", "</license><depend>nowhere_msgs</depend>"))
    assert check_launch_file(source, [{}], own=True).missing == (
        "the ROS 2 package nowhere_msgs, which roamer2 needs, is missing: install ros-jazzy-nowhere-msgs",
    )
    program = tmp_path / "roamer2/roamer2/watch.py"
    program.write_text(f"import pages.own_msgs\nfrom elsewhere_msgs.msg import Seen\n{program.read_text()}")
    (tmp_path / "roamer2/own_msgs.py").touch()
    assert check_launch_file(source, [{}], own=True).missing[1:] == (
        "the ROS 2 package elsewhere_msgs, which roamer2/roamer2/watch.py, line 2 imports, is missing: "
        "install ros-jazzy-elsewhere-msgs",
    )
    manifest.write_text(manifest.read_text().replace(">rclpy<", ">rclcpp<"))
    told = check_launch_file(source, [{}], own=True)
    assert (told.has_ros, "/roam (roamer2 roam) needs rclcpp: install ros-jazzy-rclcpp" in told.ros) == (False, True)
