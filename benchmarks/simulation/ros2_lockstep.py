"""What lock-step with nodes of ROS 2 costs: how soon they begin, what a control step takes, and their memory.

``python -m benchmarks.simulation.ros2_lockstep --document docs/reference/ros2.md`` with the ROS 2 that
``AMENT_PREFIX_PATH`` names. Numbers of lanes and of nodes take turns; the tables have medians of what the wall's clock
and the processor say. Nodes are those of examples/ros/roamer2, ``roam`` alone and with ``watch``, or a ``--bundle``'s.
"""

import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.harness import ROOT, markdown, options, show
from specs.ros_robot import RosRobot
from tasks.ros.lockstep.exchange import Launch, RobotBase, Sensed
from tasks.ros.lockstep.ros2_lockstep import Ros2Lockstep

TITLE = "pace of ROS 2"
_CONTROL_S, _RAYS, _RANGE_M = 0.05, 90, 8.0
_TICKS = os.sysconf("SC_CLK_TCK")
_HEAD = [
    "launch file",
    "nodes",
    "lanes",
    "start s",
    "start cpu s a node",
    "ms a step",
    "x real time in all",
    "cpu ms a lane's step: nodes",
    "Simyard",
    "nodes' PSS MB",
    "late and stray",
]
_ALONE = """
from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription([Node(package="roamer2", executable="roam", name="roam")])
"""


class _Cost(NamedTuple):
    """What one chunk took; times in seconds, of a control step for all lanes."""

    nodes: int
    start_s: float
    node_start_s: float
    step_s: float
    nodes_step_s: float
    own_step_s: float
    held_mb: float
    faults: int


def _sensed(step: int) -> Sensed:
    """Returns what a robot senses that turns among walls."""
    angles = 2.0 * np.pi / _RAYS * np.arange(_RAYS) + 0.02 * step
    ranges_m = (1.2 + 0.8 * np.cos(3.0 * angles)).astype(np.float32)
    pose = np.array([0.0, 0.0, 0.02 * step])
    return Sensed(pose, np.array([0.0, 0.0, 0.4]), np.zeros(2), ranges_m, np.zeros(0, bool), np.array([2.0, 2.0]))


def _spent_s(pids: Iterable[int]) -> float:
    """Returns what processes took of the processor."""
    stats = (Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for pid in pids)
    return sum(int(words[11]) + int(words[12]) for words in stats) / _TICKS


def _held_mb(pids: Iterable[int]) -> float:
    """Returns what processes hold of memory: what several share counts in equal parts (PSS)."""
    lines = (line for pid in pids for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines())
    return sum(int(line.split()[1]) for line in lines if line.startswith("Pss:")) / 1024


def _measure(bundle: Path, package: str, file: str, lanes: int, steps: int) -> _Cost:
    base = RobotBase(RosRobot(), _RAYS, -np.pi, 2.0 * np.pi / _RAYS, _RANGE_M)
    with tempfile.TemporaryDirectory(prefix="simyard-ros2-") as folder:
        launch = Launch(bundle, package, file, Path(folder) / "home", [{}] * lanes)
        begun_s = time.perf_counter()
        with Ros2Lockstep(launch, base, _CONTROL_S) as lockstep:
            lockstep.begin([_sensed(0)] * lanes, [None] * lanes)
            start_s = time.perf_counter() - begun_s
            pids = [pid for lane in range(lanes) for pid in lockstep.processes(lane)]
            before_s, own_s, stepped_s = _spent_s(pids), time.process_time(), time.perf_counter()
            for step in range(steps):
                lockstep.exchange([_sensed(step)] * lanes)
            ended_s = time.perf_counter()
            if lockstep.failures:
                raise RuntimeError(f"{file} in {lanes} lanes: {lockstep.failures}")
            own_s, nodes_s = time.process_time() - own_s, _spent_s(pids) - before_s
            tallies = [lockstep.tally(lane) for lane in range(lanes)]
            return _Cost(
                len(pids) // lanes,
                start_s,
                before_s / len(pids),
                (ended_s - stepped_s) / steps,
                nodes_s / steps / lanes,
                own_s / steps / lanes,
                _held_mb(pids),
                sum(each.late + each.stray for each in tallies),
            )


def _row(file: str, lanes: int, costs: Sequence[_Cost]) -> list[str]:
    median = _Cost(*map(statistics.median, zip(*costs, strict=True)))
    milliseconds = [f"{1000 * each:.1f}" for each in (median.step_s, median.nodes_step_s, median.own_step_s)]
    starts = [f"{median.start_s:.1f}", f"{median.node_start_s:.2f}"]
    pace = f"{lanes * _CONTROL_S / median.step_s:.1f}"
    held, faults = f"{median.held_mb:.0f}", str(sum(each.faults for each in costs))
    return [file, f"{median.nodes:.0f}", str(lanes), *starts, milliseconds[0], pace, *milliseconds[1:], held, faults]


def main() -> None:
    """Measures and prints, or writes into a document."""
    parser = options(__doc__)
    parser.add_argument("--bundle", type=Path, help="a folder with packages, instead of examples/ros/roamer2")
    parser.add_argument("--package", default="roamer2")
    parser.add_argument("--launch", nargs="+", default=["alone.launch.py", "roam.launch.py"], metavar="FILE")
    parser.add_argument("--lanes", nargs="+", type=int, default=[1, 4, 8])
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--steps", type=int, default=100)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="simyard-bundle-") as folder:
        bundle: Path = asked.bundle.resolve() if asked.bundle else Path(folder)
        if not asked.bundle:
            shutil.copytree(ROOT / "examples/ros/roamer2", bundle / "roamer2")
            (bundle / "roamer2/launch/alone.launch.py").write_text(_ALONE)
        kinds = [(file, lanes) for file in asked.launch for lanes in asked.lanes]
        costs: dict[tuple[str, int], list[_Cost]] = {kind: [] for kind in kinds}
        for _ in range(asked.turns):
            for file, lanes in kinds:
                costs[file, lanes].append(_measure(bundle, asked.package, file, lanes, asked.steps))
    show(
        TITLE, markdown([_HEAD, *(_row(file, lanes, found) for (file, lanes), found in costs.items())]), asked.document
    )


if __name__ == "__main__":
    main()
