"""What ROS 1 applications in lock-step cost: control steps a second, time until they are ready, memory of an episode.

    .venv/bin/python -m benchmarks.ros.lockstep_pace [--steps N] [--lanes 1 8 32] [--applications answer wheel]

The world costs nothing (toy_world.py). "x real time" counts the simulated time of all episodes. The last column says
whether lock-step held: commands after a lane was taken for quiet, and stages that took too long.
"""

import argparse
import resource
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from benchmarks.repository import ROOT
from benchmarks.ros.toy_world import BASE, CONTROL_S, ToyWorld
from benchmarks.tables import markdown
from tasks.ros.lockstep.exchange import Launch
from tasks.ros.lockstep.ros1_lockstep import Ros1Lockstep

_HEAD = ("application", "episodes", "steps/s in all", "x real time", "ready, s", "PSS an episode, MB", "stray, late")
_APPLICATIONS = ("answer", "listen", "steady", "relay", "wheel", "ask")
_LIBRARIES = ("roscpp", "rostime", "rosconsole", "roscpp_serialization", "boost_thread", "pthread")


class Pace(NamedTuple):
    """What one run took."""

    steps_per_s: float
    ready_s: float
    pss_bytes: int
    stray: int
    late: int


def bundle(folder: Path) -> Path:
    """Returns a bundle with the tests' package of small nodes, its program in C++ compiled."""
    shutil.copytree(ROOT / "tests/data/ros/courier", folder / "courier")
    source, program = folder / "courier/src/wheel.cpp", folder / "courier/scripts/wheel"
    subprocess.run(["g++", "-O1", "-o", program, source, *(f"-l{name}" for name in _LIBRARIES)], check=True)
    return folder


def pace(folder: Path, application: str, lanes: int, steps: int) -> Pace:
    """Returns what episodes of an application took."""
    with tempfile.TemporaryDirectory() as home:
        launch = Launch(folder, "courier", f"{application}.launch", Path(home) / "lanes", [{}] * lanes)
        begun_s = time.perf_counter()
        with Ros1Lockstep(launch, BASE, CONTROL_S) as lockstep:
            worlds = [ToyWorld(seed) for seed in range(lanes)]
            lockstep.begin([world.sense() for world in worlds], [None] * lanes)
            ready_s, begun_s = time.perf_counter() - begun_s, time.perf_counter()
            for _ in range(steps):
                for world, command in zip(worlds, lockstep.exchange([each.sense() for each in worlds]), strict=True):
                    world.drive(command)
            took_s = time.perf_counter() - begun_s
            if lockstep.failures:
                raise SystemExit(f"{application}: {dict(lockstep.failures)}")
            tallies = [lockstep.tally(lane) for lane in range(lanes)]
            pss = sum(map(pss_bytes, lockstep.processes(0)))
    stray, late = sum(tally.stray for tally in tallies), sum(tally.late for tally in tallies)
    return Pace(lanes * steps / took_s, ready_s, pss, stray, late)


def pss_bytes(pid: int) -> int:
    """Returns a process's memory, what it shares with others by its share."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith("Pss:"))


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--lanes", type=int, nargs="+", default=[1, 8, 32])
    parser.add_argument("--applications", nargs="+", default=_APPLICATIONS, choices=_APPLICATIONS)
    given = parser.parse_args()
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    rows: list[tuple[str, ...]] = []
    with tempfile.TemporaryDirectory() as place:
        folder = bundle(Path(place))
        for application in given.applications:
            for lanes in given.lanes:
                found = pace(folder, application, lanes, given.steps)
                numbers = (f"{found.steps_per_s:.0f}", f"{found.steps_per_s * CONTROL_S:.1f}", f"{found.ready_s:.1f}")
                rest = (f"{found.pss_bytes / 1e6:.1f}", f"{found.stray}, {found.late}")
                rows.append((application, str(lanes), *numbers, *rest))
    print(markdown([_HEAD, *rows]))


if __name__ == "__main__":
    main()
