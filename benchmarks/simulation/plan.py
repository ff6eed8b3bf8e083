"""What `simyard plan` predicts beside what `simyard run` takes: wall seconds and memory, before and after a first run.

    .venv/bin/python -m benchmarks.simulation.plan [--json FILE] [--case NAME ...] [--document PAGE]

Each case has a cache folder of its own: the first prediction is a wide range, those after it rest on the run before.
Each run is a process of its own with a new store, and its wall time is that of the whole command. A case takes one to
three minutes. In parts: the figures in FILE are kept, and the tables have them all.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from benchmarks.harness import ROOT, machine, markdown, options, show
from benchmarks.process_times import run_watched

SIMYARD = str(Path(sys.executable).with_name("simyard"))
# Engine, worlds, seeds, and the longest time of an episode: of a run, of the next one, and so on.
Batch = tuple[str, int, int, int]
_SMALL: Batch = ("planar", 8, 4, 60)
CASES: dict[str, tuple[Batch, ...]] = {
    "planar, 64": (_SMALL,) * 3,
    "planar, 64, then 1,008": (_SMALL, ("planar", 8, 63, 60), ("planar", 8, 63, 60)),
    "planar, 384": (("planar", 8, 24, 60),) * 2,
    "planar, 384 in 48 worlds": (("planar", 48, 4, 60),) * 2,
    "planar, 384 in 48 worlds, then in 8": (("planar", 48, 4, 60), ("planar", 8, 24, 60)),
    "planar, 2,048": (("planar", 8, 128, 60),) * 2,
    "planar, 384 of 10 s": (("planar", 8, 24, 10),) * 2,
    "mujoco, 64": (("mujoco", 8, 4, 60),) * 2,
    "mjx, 64": (("mjx", 8, 4, 60),) * 2,
}
_ABOUT = re.compile(r"about (\S+) (s|min|h) \((\S+) to (\S+)\) and (\S+) to (\S+) GB")
_PERHAPS = re.compile(r"perhaps (\S+) to (\S+) (s|min|h) and (\S+) to (\S+) GB")
_LOOK_S = 0.5
_SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0}


class Turn(NamedTuple):
    """One prediction, from and to, and what the run took after it: seconds, and GB of the process that simulates."""

    told_s: float
    wall_s: tuple[float, float]
    memory_gb: tuple[float, float]
    took_s: float
    peak_gb: float


def document(engine: str, worlds: int, seeds: int, duration_s: int) -> str:
    """Returns a pipeline of so many worlds and seeds, and two speeds."""
    launch = {"packageName": "courier", "launchFile": "go_to_goal"}
    goals = {"packageName": "delivery", "launchFile": "rooms"}
    job = {
        "maxJobDurationInSeconds": duration_s,
        "robotApplications": [{"application": "courier", "launchConfig": launch}],
        "simulationApplications": [{"application": "delivery", "launchConfig": goals}],
    }
    batch = {
        "engine": engine,
        "matrix": {"seeds": seeds, "environmentVariables": {"MAX_SPEED": ["0.4", "0.6"]}},
        "createSimulationJobRequests": [job],
    }
    template = str(ROOT / "examples/templates/two-rooms.json")
    count = {"floorplanCount": worlds, "interiorCountPerFloorplan": 1}
    generation = {"template": template, "worldCount": count, "seed": 7}
    return json.dumps({"name": "predicted", "worldGeneration": generation, "simulationBatch": batch})


def measured(file: Path, store: str, environment: Mapping[str, str]) -> Turn:
    """Returns a prediction and what came of it."""
    told = subprocess.check_output([SIMYARD, "plan", str(file), "--store", store], env=environment, text=True)
    if found := _ABOUT.search(told):
        told_as, unit, low, high, least, most = found.groups()
    elif found := _PERHAPS.search(told):
        low, high, unit, least, most = found.groups()
        told_as = (float(low) * float(high)) ** 0.5
    else:
        raise SystemExit(f"no prediction: {told}")
    scale = _SECONDS[unit]
    ran = run_watched([SIMYARD, "run", str(file), "--store", store], environment, ROOT, look_s=_LOOK_S)
    wall_s = (float(low) * scale, float(high) * scale)
    peak_gb = ran.held_mb["simulation"] / 1e3
    return Turn(float(told_as) * scale, wall_s, (float(least), float(most)), ran.ended_s - ran.began_s, peak_gb)


def all_runs(name: str) -> dict[str, Turn]:
    """Returns the predictions before each of a case's runs."""
    turns: dict[str, Turn] = {}
    with tempfile.TemporaryDirectory(prefix="simyard-bench-") as folder:
        file = Path(folder) / "document.json"
        environment = {**os.environ, "SIMYARD_CACHE": f"{folder}/cache"}
        for run, batch in enumerate(CASES[name]):
            file.write_text(document(*batch))
            turns[f"{name}, run {run + 1}"] = measured(file, (Path(folder) / f"store-{run}").as_uri(), environment)
    return turns


def kept(file: Path | None) -> dict[str, Turn]:
    """Returns the figures of the parts before this one."""
    if file is None or not file.exists():
        return {}
    found = json.loads(file.read_text())
    return {
        name: Turn(told, (low, high), (least, most), *took)
        for name, (told, (low, high), (least, most), *took) in found.items()
    }


def table(figures: Mapping[str, Turn]) -> str:
    """Returns the predictions beside what came of them."""
    rows = [("case", "wall predicted", "taken", "predicted / taken", "memory predicted", "taken")]
    for name, turn in figures.items():
        wall = f"{turn.told_s:.0f} s ({turn.wall_s[0]:.0f} to {turn.wall_s[1]:.0f})"
        memory = f"{turn.memory_gb[0]:.1f} to {turn.memory_gb[1]:.1f} GB"
        ratio, peak = f"{turn.told_s / turn.took_s:.2f}", f"{turn.peak_gb:.1f} GB"
        rows.append((name, wall, f"{turn.took_s:.0f} s", ratio, memory, peak))
    return markdown(rows)


def main() -> None:
    """Prints the table, and writes it into a page."""
    parser = options(__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--case", nargs="*", choices=list(CASES), default=list(CASES))
    given = parser.parse_args()
    figures = kept(given.json)
    for name in given.case:
        figures |= all_runs(name)
    if given.json:
        given.json.write_text(json.dumps(figures, indent=2))
    show("plan", f"{machine()}\n\n{table(figures)}", given.document)


if __name__ == "__main__":
    main()
