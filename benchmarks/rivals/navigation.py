"""Control steps of robots a processor second: Simyard beside IR-SIM, JaxNav and PufferLib's Ocean, in one run.

    python -m benchmarks.rivals.navigation --python RIVALS_PYTHON --puffer FOLDER [--turns N] [--document FILE]
    python -m benchmarks.rivals.navigation --python RIVALS_PYTHON --people 8 [--turns N] [--document FILE]

RIVALS_PYTHON has ``ir-sim`` and ``jaxmarl`` installed, and ``pysocialforce`` for people; FOLDER is ``pufferlib`` in its
source distribution of 3.0.0. What is not given is left out. Each is a process of its own, and as many processes as
cores where a program uses one. They take turns while the others wait. The processor time is compared, which other work
changes less than the wall.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import NamedTuple

from benchmarks.harness import ROOT, machine, markdown, options, show
from benchmarks.rivals.ocean import ENVIRONMENTS, built
from tasks.simulate.devices import device_count

TURN_S = 3.0
OURS = "Simyard planar"


class Rival(NamedTuple):
    """A program that answers turns.

    Attributes:
        name: What it is.
        step: What a control step of it holds.
        command: Starts it.
        copies: How many run at once: as many as cores where it uses one.
        environment: Beside this process's own.
    """

    name: str
    step: str
    command: Sequence[str]
    copies: int = 1
    environment: Mapping[str, str] = {}


class Turn(NamedTuple):
    """Control steps a wall second, and a processor second."""

    wall: float
    cpu: float


def rivals(python: str | None, puffer: Path | None, folder: Path) -> Iterator[Rival]:
    """Yields what can be measured."""
    cores, here = device_count(), {"PYTHONPATH": str(ROOT)}
    module = [sys.executable, "-m", "benchmarks.rivals.simyard_robots"]
    ours = "10 physics steps with contact, 32 exact rays among 100 solids, noise, scenario, records"
    yield Rival(OURS, ours, [*module, "planar"], environment=here)
    yield Rival("Simyard mujoco", ours, [*module, "mujoco"], environment=here)
    if python:
        told = "moved without physics, 32 rays among 100 boxes"
        yield Rival("IR-SIM", told, [python, "-m", "benchmarks.rivals.irsim_robots"], cores, here)
        for robots, rays in ((256, 32), (1024, 32), (256, 200)):
            told = f"moved without physics, {rays} rays in steps of 5 cm, a map of 11 x 11 cells, {robots:,} at a time"
            command = [python, "-m", "benchmarks.rivals.jaxnav_robots", str(robots), str(rays)]
            yield Rival(f"JaxNav, {robots:,} robots, {rays} rays", told, command, environment=here)
    if puffer:
        toy = {
            "target": "moved without physics, no obstacle, sees where 4 goals and 8 robots are",
            "gpudrive": "cars moved without physics, sees the 200 nearest pieces of road, boxes collide",
        }
        for name, environment in ENVIRONMENTS.items():
            where = {"OCEAN_MAP": str(puffer / environment.map)}
            yield Rival(f"Ocean {name}", toy[name], [str(built(puffer, name, folder))], cores, where)


def among_people(python: str, people: int) -> Iterator[Rival]:
    """Yields what moves a robot among people, or people alone."""
    cores, here, walk = device_count(), {"PYTHONPATH": str(ROOT)}, str(people)
    ours = (
        f"10 physics steps with contact, 32 exact rays among 25 solids and {people} people who mind it, noise, scenario"
    )
    module = [sys.executable, "-m", "benchmarks.rivals.simyard_robots", "planar"]
    yield Rival(OURS, ours, [*module, walk], environment=here)
    told = f"moved without physics, 32 rays among 25 boxes and {people} circles that mind it (RVO)"
    yield Rival("IR-SIM", told, [python, "-m", "benchmarks.rivals.irsim_robots", walk], cores, here)
    told = f"moved without physics, 32 rays in steps of 5 cm, {people} others that are such robots and mind nobody"
    yield Rival("JaxNav", told, [python, "-m", "benchmarks.rivals.jaxnav_robots", "256", "32", walk], environment=here)
    told = f"no robot: {people} people by the social force among 25 walls"
    command = [python, "-m", "benchmarks.rivals.social_force_people", walk]
    yield Rival("PySocialForce", told, command, cores, here)


class _Running:
    """A rival's processes."""

    def __init__(self, rival: Rival) -> None:
        environment = {**os.environ, **rival.environment}
        self._children = [
            subprocess.Popen(
                rival.command,
                env=environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
            for _ in range(rival.copies)
        ]
        for child in self._children:
            _answer(rival.name, child)
        self.name, self.step = rival.name, rival.step

    def turn(self) -> Turn:
        for child in self._children:
            if child.stdin is not None:
                child.stdin.write(f"{TURN_S}\n")
                child.stdin.flush()
        told = [_answer(self.name, child) for child in self._children]
        steps = sum(each["steps"] for each in told)
        cpu = steps / sum(each["cpu_s"] for each in told)
        return Turn(sum(each["steps"] / each["wall_s"] for each in told), cpu)

    def end(self) -> None:
        for child in self._children:
            child.communicate()


def _answer(name: str, child: "subprocess.Popen[str]") -> dict[str, float]:
    """Returns the next line of JSON; what else a rival prints is passed over."""
    for line in child.stdout or ():
        if line.startswith("{"):
            return json.loads(line)
    raise RuntimeError(f"{name} ended: run its command by hand to see why")


def measured(found: Sequence[Rival], turns: int) -> list[list[str]]:
    """Returns the table; the rivals take turns."""
    running = [_Running(rival) for rival in found]
    try:
        rounds = [[each.turn() for each in running] for _ in range(turns)]
    finally:
        for each in running:
            each.end()
    by_name = {each.name: [turn[place] for turn in rounds] for place, each in enumerate(running)}
    table = [["robots of", "k steps/s", "k steps a processor s", "Simyard's are", "a step"]]
    for each in running:
        ours, theirs = by_name[OURS], by_name[each.name]
        times = median(one.cpu / other.cpu for one, other in zip(ours, theirs, strict=True))
        wall, cpu = (median(getattr(turn, kind) for turn in theirs) / 1e3 for kind in ("wall", "cpu"))
        table.append([each.name, f"{wall:,.2f}", f"{cpu:,.2f}", f"{times:,.2f} times", each.step])
    return table


def main() -> None:
    """Prints the table, and puts it into a document."""
    asked = options(__doc__)
    asked.add_argument("--python", help="an interpreter that has ir-sim and jaxmarl")
    asked.add_argument("--puffer", type=Path, help="the folder pufferlib of its source distribution")
    asked.add_argument("--people", type=int, default=0, help="how many walk beside a robot")
    asked.add_argument("--turns", type=int, default=7)
    given = asked.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        alone = rivals(given.python, given.puffer, Path(folder))
        found = [*(among_people(given.python, given.people) if given.people else alone)]
        table = markdown(measured(found, given.turns))
    show("rivals among people" if given.people else "rivals", f"{machine()}\n\n{table}", given.document)


if __name__ == "__main__":
    main()
