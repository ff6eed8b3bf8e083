"""One batch on this process, on one and two Dask workers, and on Ray: the same tables, how fast, and what it costs.

    .venv/bin/python -m benchmarks.scale.scale [--episodes N ...] [--crew WORKERS ...] [--document
    docs/operate/scale.md]

Each run is a process of its own with a new store, and a cache that an earlier run of the same kind has filled. Workers
are processes that are reached over TCP. The wall clock runs from the call of the flow `simulation-batch` to its end:
plan, workers' start, episodes, tables, audit, report. What workers spend on loading, compiling and driving is
simulation; the rest of the seconds that they had is orchestration.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, cast

import pyarrow as pa
import yaml

from benchmarks.machine import machine
from benchmarks.repository import ROOT
from benchmarks.tables import markdown, with_tables

QUICKSTART = ROOT / "examples/quickstart.yaml"
CREWS = ("", "dask:1", "dask:2", "ray:2")
SIZES = (1_000, 10_000, 100_000)
_SPREAD_EPISODES = 10_000
# Short ones are the harder case: the less there is to simulate, the more the rest weighs.
_DURATION_S = 5
_WORLDS, _SETTINGS = 8, 2


class Run(NamedTuple):
    """What one run of a batch took.

    Attributes:
        crew: SIMYARD_WORKERS; empty for the flow's own process.
        wall_s: Of the flow.
        spread_s: Of its episodes alone: from the first chunk's beginning to the last one's end.
        simulated_s: That all workers together spent on loading, compiling and driving.
        workers: How many did something.
        tables: A digest of all rows of results and failures.
    """

    crew: str
    episodes: int
    wall_s: float
    spread_s: float
    simulated_s: float
    workers: int
    tables: str

    def orchestration(self) -> float:
        """Returns the share of the flow's wall clock in which a worker, of those that there were, did not simulate."""
        return 1.0 - self.simulated_s / (self.wall_s * self.workers)


def section(episodes: int) -> dict[str, object]:
    """Returns the quickstart's batch with as many seeds as make so many episodes of few seconds."""
    batch = yaml.safe_load(QUICKSTART.read_text())["simulationBatch"]
    batch["matrix"]["seeds"] = episodes // (_WORLDS * _SETTINGS)
    batch["batchPolicy"] = {"timeoutInSeconds": 7200, "maxConcurrency": 256}
    for job in batch["createSimulationJobRequests"]:
        job["maxJobDurationInSeconds"] = _DURATION_S
    return batch


def measured(crew: str, episodes: int, cache: Path) -> Run:
    """Returns what a run in a process of its own took, the first one of its kind having filled the cache."""
    with tempfile.TemporaryDirectory(prefix="simyard-scale-") as folder:
        environment = {**os.environ, "SIMYARD_WORKERS": crew, "SIMYARD_CACHE": str(cache)}
        told = Path(folder) / "run.json"
        command = [sys.executable, "-m", "benchmarks.scale.scale", "--child", str(episodes), "--store", folder]
        subprocess.run(command, env=environment, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
        return Run(crew, episodes, **json.loads(told.read_text()))


def run_child(episodes: int, folder: Path) -> None:
    """Runs a batch in this process, and leaves what it took in the folder."""
    from flows.server.prefect_server import prefect_server  # noqa: PLC0415 - Prefect takes its settings from the child's environment

    store_url = (folder / "store").as_uri()
    with prefect_server():
        from flows.simulation_batch import simulation_batch  # noqa: PLC0415 - as above
        from flows.world_generation import world_generation  # noqa: PLC0415 - as above
        from specs.pipeline.simulation_section import SimulationBatch  # noqa: PLC0415 - as above
        from specs.pipeline.world_sections import WorldGeneration  # noqa: PLC0415 - as above

        document = yaml.safe_load(QUICKSTART.read_text())
        worlds = world_generation(
            WorldGeneration.model_validate(document["worldGeneration"] | {"worldCount": {"floorplanCount": _WORLDS}}),
            store_url,
            str(QUICKSTART.parent),
        )
        spec = SimulationBatch.model_validate(section(episodes))
        start_s = time.perf_counter()
        record = simulation_batch(spec, cast("list[str]", worlds.detail["worlds"]), store_url)
        wall_s = time.perf_counter() - start_s
    metrics = cast("dict[str, float]", record.detail["metrics"])
    figures = {
        "wall_s": wall_s,
        "spread_s": metrics["wall_s"],
        "simulated_s": metrics["ready_s"] + metrics["compile_s"] + metrics["drive_s"],
        "workers": metrics["workers"],
        "tables": _digest(folder / "store"),
    }
    (folder / "run.json").write_text(json.dumps(figures))


def _digest(root: Path) -> str:
    hashed = hashlib.sha256()
    for file in sorted(root.glob("buckets/results/**/*.parquet")):
        from pyarrow import parquet  # noqa: PLC0415 - a child has it already

        table = parquet.read_table(file)
        for batch in table.to_batches():
            sink = pa.BufferOutputStream()
            with pa.ipc.new_stream(sink, table.schema.remove_metadata()) as stream:
                stream.write_batch(batch)
            hashed.update(file.name.encode() + sink.getvalue().to_pybytes())
    return hashed.hexdigest()


def crew_table(runs: Sequence[Run]) -> str:
    """Returns the table of one batch on several crews; the first is the one that others are compared with.

    Raises:
        ValueError: Two of them wrote different tables.
    """
    if len({run.tables for run in runs}) != 1:
        raise ValueError(f"the tables differ: { {run.crew: run.tables for run in runs} }")
    one = next((run for run in runs if run.crew.endswith(":1")), runs[0])
    rows = [["workers", "flow, s", "episodes, s", "episodes/s", "as fast as one", "not simulation, %"]]
    rows += [
        [
            run.crew or "the flow itself",
            f"{run.wall_s:.1f}",
            f"{run.spread_s:.1f}",
            f"{run.episodes / run.spread_s:.0f}",
            f"{one.spread_s / run.spread_s:.2f}",
            f"{100 * run.orchestration():.0f}",
        ]
        for run in runs
    ]
    return markdown(rows)


def size_table(runs: Sequence[Run]) -> str:
    """Returns the table of batches of several sizes."""
    rows = [["episodes", "flow, s", "simulation, s", "not simulation, %"]]
    for run in runs:
        share = f"{100 * run.orchestration():.1f}"
        rows.append([f"{run.episodes:,}", f"{run.wall_s:.1f}", f"{run.simulated_s / run.workers:.1f}", share])
    return markdown(rows)


def main() -> None:
    """Prints the tables, or writes them into a document."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--crew", nargs="+", default=CREWS)
    parser.add_argument("--document", type=Path)
    parser.add_argument("--child", type=int)
    parser.add_argument("--store", type=Path)
    given = parser.parse_args()
    if given.child:
        run_child(given.child, given.store)
        return
    with tempfile.TemporaryDirectory(prefix="simyard-scale-cache-") as cache:
        spread = min(max(given.episodes), _SPREAD_EPISODES)
        for crew in given.crew:
            measured(crew, 512, Path(cache))  # compiles
        crews = crew_table([measured(crew, spread, Path(cache)) for crew in given.crew])
        sizes = size_table([measured("", episodes, Path(cache)) for episodes in given.episodes])
    tables = f"{machine()} A batch of {spread:,} episodes:\n\n{crews}\n\nIn the flow's own process:\n\n{sizes}"
    if given.document:
        given.document.write_text(with_tables(given.document.read_text(), "scale", tables))
    else:
        sys.stdout.write(f"{tables}\n")


if __name__ == "__main__":
    main()
