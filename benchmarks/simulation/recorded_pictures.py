"""What it costs a batch that its recordings keep pictures (``picturesHz``): figures of docs/guide/cameras.md.

``MUJOCO_GL=osmesa python -m benchmarks.simulation.recorded_pictures``. Each run is `simyard run` with a new store and
programs that are compiled before; the forms of recordings take turns. All episodes are recorded, at 10 Hz.
"""

import itertools
import os
import statistics
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import pyarrow.parquet as pq
import yaml

from benchmarks.harness import ROOT, machine, markdown, options, show
from benchmarks.process_times import run_watched

_SIZES = ((64, 48), (160, 120))
_FORMS: Mapping[str, Mapping[str, object]] = {
    "no pictures": {},
    "2 a second": {"picturesHz": 2},
    "2 a second, and bags of ROS 2": {"picturesHz": 2, "bags": ["rosbag2"]},
}
_TURNS, _LOOK_S = 3, 0.5
_ROBOT = """
import numpy as np

jax = False


class Depth:
    columns, rows, fov_rad, range_m, z_m, rate_hz, sigma_m_per_m2 = {size}, 1.2, 10.0, 0.3, 10.0, 0.002


class Color:
    columns, rows, rate_hz, noise = {size}, 10.0, 0.02


class Seer:
    depth_camera, color_camera = Depth(), Color()

    def reset(self, floor, goals_m):
        pass

    def step(self, observation):
        return np.array([0.2, 0.1, 0.0], np.float32)


def controller(environment):
    return Seer()
"""


class _Run(NamedTuple):
    """What a run took of the processor, what its episodes lasted, and what its recordings and bags weigh."""

    spent_s: float
    simulated_s: float
    size_mb: float


def _document(folder: Path, recordings: Mapping[str, object]) -> Path:
    job = {
        "maxJobDurationInSeconds": 30,
        "robotApplications": [
            {"application": "seer", "launchConfig": {"packageName": "seer", "launchFile": "seer"}},
        ],
        "simulationApplications": [
            {
                "application": "delivery",
                "launchConfig": {
                    "packageName": "delivery",
                    "launchFile": "rooms",
                    "environmentVariables": {"GOALS": "1"},
                },
            }
        ],
    }
    document = {
        "name": "seer",
        "applications": [{"name": "seer", "kind": "robot", "source": "robot"}],
        "worldGeneration": {
            "template": str(ROOT / "benchmarks" / "templates" / "six-room-flat.json"),
            "worldCount": {"floorplanCount": 2},
        },
        "simulationBatch": {
            "outputLocation": {"s3Bucket": "results", "s3Prefix": "seer"},
            "recordings": {"episodes": "all", "rateHz": 10, **recordings},
            "matrix": {"worlds": "all", "seeds": 16},
            "createSimulationJobRequests": [job],
        },
    }
    path = folder / "seer.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def _run(folder: Path, recordings: Mapping[str, object]) -> _Run:
    settings = {"SIMYARD_CACHE": str(folder / "cache"), "PYTHONPATH": str(ROOT)}
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PREFECT_", "SIMYARD_"))}
    document = _document(folder, recordings)
    with tempfile.TemporaryDirectory(prefix="simyard-bench-") as place:
        command = [sys.executable, "-m", "simyard", "run", str(document), "--store", (Path(place) / "store").as_uri()]
        ran = run_watched(command, {**kept, **settings}, ROOT, look_s=_LOOK_S)
        files = [each for each in Path(place).rglob("*") if each.is_file()]
        (results,) = (each for each in files if each.name == "results.parquet")
        simulated = pq.read_table(results, columns=["simulated_s"]).column(0).to_pylist()
        size = sum(each.stat().st_size for each in files if {"recordings", "bags"} & set(each.parts))
    return _Run(ran.spent_s, sum(simulated), size / 1e6)


def main() -> None:
    """Measures, and prints the table or puts it into a document."""
    arguments = options(__doc__).parse_args()
    rows = [["each of two cameras", "recordings keep", "processor time", "beyond no pictures", "a minute weighs"]]
    for columns, lines in _SIZES:
        with tempfile.TemporaryDirectory(prefix="simyard-seer-") as place:
            folder = Path(place)
            robot = folder / "robot"
            (robot / "seer").mkdir(parents=True)
            (robot / "seer" / "seer.py").write_text(_ROBOT.format(size=f"{columns}, {lines}"))
            (robot / "robot.xml").write_bytes((ROOT / "applications" / "courier" / "robot.xml").read_bytes())
            found: dict[str, list[_Run]] = {form: [] for form in _FORMS}
            _run(folder, {"picturesHz": 2})  # compiles
            for _, (form, recordings) in itertools.product(range(_TURNS), _FORMS.items()):
                found[form].append(_run(folder, recordings))
                print(columns, form, found[form][-1], flush=True)
        spent_s = {form: statistics.median(each.spent_s for each in runs) for form, runs in found.items()}
        for form, runs in found.items():
            more_s, minutes = spent_s[form] - spent_s["no pictures"], runs[0].simulated_s / 60
            shown = f"{more_s:+.1f} s" if more_s else ""
            size = f"{runs[0].size_mb / minutes:.2f} MB"
            rows.append([f"{columns}x{lines}", form, f"{spent_s[form]:.1f} s", shown, size])
    note = f"Processor time of the whole run, the median of {_TURNS} turns, of 32 episodes"
    show("recorded pictures", f"{markdown(rows)}\n\n{note}, on {machine()}", arguments.document)


if __name__ == "__main__":
    main()
