"""Outcomes of the shipped applications in 48 two-room worlds, by world: drives them, and writes the counts.

Half an hour on two cores. ``resampled_worlds`` then asks how often the interval of a few of the worlds holds the rate
of all.

    python -m benchmarks.statistics.real_batches --store FOLDER
"""

import argparse
import json
from collections import Counter
from pathlib import Path

import simyard
from benchmarks.harness import ROOT

COUNTS = Path(__file__).parent / "real_batches.json"
SEEDS = 24
_TEMPLATE = str(ROOT / "examples/templates/two-rooms.json")
_DELIVERY, _COVERAGE = ("delivery", "rooms"), ("coverage", "floor")
_BATCHES = {
    "courier delivering, odometry noise 0.2": (("courier", "go_to_goal"), _DELIVERY, 60, {"ODOMETRY_SIGMA": "0.2"}),
    "wanderer delivering": (("wanderer", "wander"), _DELIVERY, 180, {}),
    "wanderer covering floor": (("wanderer", "wander"), _COVERAGE, 180, {}),
}
Counts = dict[str, list[int]]


def drive(name: str, store: Path) -> Counts:
    """Drives one batch, and returns how many episodes of each world there were, succeeded, and touched anything."""
    robot, scenario, duration_s, environment = _BATCHES[name]
    document = {
        "name": "real-" + "-".join(name.replace(",", "").replace(".", "").split()),
        "worldGeneration": {
            "template": _TEMPLATE,
            "worldCount": {"floorplanCount": 24, "interiorCountPerFloorplan": 2},
            "seed": 7,
        },
        "simulationBatch": {
            "batchPolicy": {"maxConcurrency": 192},
            "outputLocation": {"s3Bucket": "results"},
            "matrix": {"worlds": "all", "seeds": SEEDS},
            "createSimulationJobRequests": [
                {
                    "maxJobDurationInSeconds": duration_s,
                    "robotApplications": [_application(robot, environment)],
                    "simulationApplications": [_application(scenario, {})],
                }
            ],
        },
    }
    run = simyard.run(document, store=store, direct=True)
    rows = simyard.results(run).to_arrow().select(["world", "success", "collisions"]).to_pylist()
    return by_world(rows)


def by_world(rows: list[dict[str, object]]) -> Counts:
    """Returns the counts of rows, world by world in the order of their names."""
    n = Counter(str(row["world"]) for row in rows if row["success"] is not None)
    passed = Counter(str(row["world"]) for row in rows if row["success"])
    touched = Counter(str(row["world"]) for row in rows if row["collisions"])
    return {
        "episodes": [n[world] for world in sorted(n)],
        "success": [passed[world] for world in sorted(n)],
        "collision": [touched[world] for world in sorted(n)],
    }


def main() -> None:
    """Drives the batches whose counts are not in the file beside this module, and writes them there."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--store", type=Path, required=True)
    options = parser.parse_args()
    counts: dict[str, Counts] = json.loads(COUNTS.read_text()) if COUNTS.exists() else {}
    for name in _BATCHES:
        if name not in counts:
            counts[name] = drive(name, options.store)
            COUNTS.write_text(json.dumps(counts) + "\n")


def _application(named: tuple[str, str], environment: dict[str, str]) -> dict[str, object]:
    launch = {"packageName": named[0], "launchFile": named[1], "environmentVariables": environment}
    return {"application": named[0], "launchConfig": launch}


if __name__ == "__main__":
    main()
