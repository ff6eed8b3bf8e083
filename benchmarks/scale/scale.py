"""One batch on this process, on one and two Dask workers, and on Ray: the same tables, how fast, and what it costs.

    .venv/bin/python -m benchmarks.scale.scale [--part waits small ...] [--document docs/operate/scale.md]

Each run is a process of its own with a new store, and a cache that an earlier run of the same kind has filled. Workers
are processes that are reached over TCP. The wall clock runs from the call of the flow `simulation-batch` to its end:
plan, workers' start, episodes, tables, audit, report. What workers spend on loading, compiling and driving is
simulation; the rest of the seconds that they had is orchestration. `pinned` gives each of one and two Dask workers a
core of its own, as two machines of one core have; `large` is 100,000 episodes; `waits` is the batch whose waits issue
19 found, 48,000 deliveries with 512 lanes, and what each kind of work took of it. Each part writes a table of its own.
"""

import hashlib
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple, cast

import pyarrow as pa
import yaml

from benchmarks.harness import ROOT, machine, markdown, options, show
from benchmarks.process_times import run_watched

QUICKSTART = ROOT / "examples/quickstart.yaml"
CREWS = ("", "dask:1", "dask:2", "ray:2")
# Dask workers, each on a core of its own.
PINNED = ("pinned:1", "pinned:2")
PARTS = ("crews", "pinned", "small", "large", "waits")
_SETTINGS = 2
_LOOK_S = 1.0


class Case(NamedTuple):
    """A batch of deliveries. Short ones are the harder case, as there is less to simulate and the rest weighs more."""

    episodes: int
    worlds: int = 8
    lanes: int = 256
    duration_s: int = 5


SMALL, LARGE = (Case(1_000), Case(10_000)), (Case(100_000),)
_SPREAD, _WARM = Case(10_000), Case(512)
_WAITS = Case(48_000, 16, 512, 20)


class Run(NamedTuple):
    """What one run of a batch took.

    Attributes:
        crew: SIMYARD_WORKERS; empty for the flow's own process.
        wall_s: Of the flow.
        spread_s: Of its episodes alone: from the first chunk's beginning to the last one's end.
        ready_s, compile_s, drive_s: That all workers together spent on making lanes ready, on compiling and on driving.
        workers: How many did something.
        own_mb: The most memory that the flow's process held.
        child_mb: The most that a process which simulates held; 0 if there was none among the flow's own.
        tables: A digest of all rows of results and failures.
    """

    crew: str
    episodes: int
    wall_s: float
    spread_s: float
    ready_s: float
    compile_s: float
    drive_s: float
    workers: int
    own_mb: float
    child_mb: float
    tables: str

    @property
    def simulated_s(self) -> float:
        """Returns the seconds that all workers together spent on loading, compiling and driving."""
        return self.ready_s + self.compile_s + self.drive_s

    def orchestration(self) -> float:
        """Returns the share of the flow's wall clock in which a worker, of those that there were, did not simulate."""
        return 1.0 - self.simulated_s / (self.wall_s * self.workers)


def section(case: Case) -> dict[str, object]:
    """Returns the quickstart's batch with as many seeds as make so many episodes of few seconds."""
    batch = yaml.safe_load(QUICKSTART.read_text())["simulationBatch"]
    batch["matrix"]["seeds"] = case.episodes // (case.worlds * _SETTINGS)
    batch["batchPolicy"] = {"timeoutInSeconds": 7200, "maxConcurrency": case.lanes}
    for job in batch["createSimulationJobRequests"]:
        job["maxJobDurationInSeconds"] = case.duration_s
    return batch


def measured(crew: str, case: Case, cache: Path) -> Run:
    """Returns what a run in a process of its own took, the first one of its kind having filled the cache."""
    with tempfile.TemporaryDirectory(prefix="simyard-scale-") as folder:
        environment = {**os.environ, "SIMYARD_CACHE": str(cache)}
        told = Path(folder) / "run.json"
        command = [sys.executable, "-m", "benchmarks.scale.scale", "--store", folder, "--child", *map(str, case)]
        with _crew(crew, environment) as workers:
            own = {**environment, "SIMYARD_WORKERS": workers}
            held_mb = run_watched(command, own, ROOT, look_s=_LOOK_S).held_mb
        return Run(
            crew,
            case.episodes,
            own_mb=held_mb["run"],
            child_mb=held_mb.get("simulation", 0.0),
            **json.loads(told.read_text()),
        )


@contextmanager
def _crew(crew: str, environment: Mapping[str, str]) -> Generator[str]:
    """Starts pinned workers and a scheduler for the length of the ``with`` block; yields SIMYARD_WORKERS."""
    if not crew.startswith("pinned:"):
        yield crew
        return
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    cores = sorted(os.sched_getaffinity(0))[: int(crew.partition(":")[2])]
    host, _, port = address.removeprefix("tcp://").partition(":")
    dask = [sys.executable, "-m", "dask"]
    with ExitStack() as stack:
        stack.enter_context(
            _running([*dask, "scheduler", "--host", host, "--port", port, "--no-dashboard"], environment)
        )
        for core in cores:
            worker = [
                *dask,
                "worker",
                address,
                "--nthreads",
                "1",
                "--no-nanny",
                "--no-dashboard",
                "--memory-limit",
                "0",
            ]
            stack.enter_context(_running(["taskset", "-c", str(core), *worker], environment))
        yield address


@contextmanager
def _running(command: Sequence[str], environment: Mapping[str, str]) -> Generator[None]:
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(command, env=dict(environment), cwd=ROOT, stdout=quiet, stderr=quiet)
    try:
        yield
    finally:
        process.terminate()
        process.wait(30)


def run_child(case: Case, folder: Path) -> None:
    """Runs a batch in this process, and leaves what it took in the folder."""
    from flows.prefect.prefect_server import prefect_server  # noqa: PLC0415 - Prefect takes its settings from the child's environment

    store_url = (folder / "store").as_uri()
    with prefect_server():
        from flows.prefect.flows import simulation_batch, world_generation  # noqa: PLC0415 - as above
        from specs.pipeline.simulation_section import SimulationBatch  # noqa: PLC0415 - as above
        from specs.pipeline.world_sections import WorldGeneration  # noqa: PLC0415 - as above

        document = yaml.safe_load(QUICKSTART.read_text())
        wanted = document["worldGeneration"] | {"worldCount": {"floorplanCount": case.worlds}}
        worlds = world_generation(WorldGeneration.model_validate(wanted), store_url, str(QUICKSTART.parent))
        spec = SimulationBatch.model_validate(section(case))
        start_s = time.perf_counter()
        record = simulation_batch(spec, cast("list[str]", worlds.detail["worlds"]), store_url)
        wall_s = time.perf_counter() - start_s
    metrics = cast("dict[str, float]", record.detail["metrics"])
    figures = {
        "wall_s": wall_s,
        "spread_s": metrics["wall_s"],
        **{name: metrics[name] for name in ("ready_s", "compile_s", "drive_s")},
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
    rows = [["episodes", "flow, s", "simulation, s", "not simulation, %", "flow, MB", "simulation, MB"]]
    for run in runs:
        share = f"{100 * run.orchestration():.1f}"
        times = [f"{run.wall_s:.1f}", f"{run.simulated_s / run.workers:.1f}"]
        rows.append([f"{run.episodes:,}", *times, share, f"{run.own_mb:.0f}", f"{run.child_mb:.0f}"])
    return markdown(rows)


def wait_table(run: Run) -> str:
    """Returns the table of where the time of one batch goes, beside what issue 19 aims at."""
    rest_s = run.wall_s - run.simulated_s / run.workers
    rows = [["what", "s", "share, %", "aim"]]
    parts = {"driving": run.drive_s, "lanes made ready": run.ready_s, "programs": run.compile_s}
    for name, seconds in {**{name: each / run.workers for name, each in parts.items()}, "the rest": rest_s}.items():
        aim = "at least 70 %" if name == "driving" else ""
        rows.append([name, f"{seconds:.1f}", f"{100 * seconds / run.wall_s:.0f}", aim])
    rows.append(["the flow", f"{run.wall_s:.1f}", "100", "140 s"])
    memory = (
        f"The flow's process held {run.own_mb:.0f} MB, the one that simulates {run.child_mb:.0f} MB; the aim is 1 GB."
    )
    return f"{markdown(rows)}\n\n{memory}"


def part_tables(part: str, cache: Path) -> str:
    """Returns what one part of the benchmark measures."""
    if part in {"crews", "pinned"}:
        crews = CREWS if part == "crews" else PINNED
        for crew in crews:
            measured(crew, _WARM, cache)  # compiles
        table = crew_table([measured(crew, _SPREAD, cache) for crew in crews])
        where = "" if part == "crews" else ", each worker on a core of its own"
        return f"{machine()} A batch of {_SPREAD.episodes:,} episodes{where}:\n\n{table}"
    if part == "waits":
        measured("", _WAITS, cache)  # compiles
        what = f"{_WAITS.episodes:,} deliveries of at most {_WAITS.duration_s} s in {_WAITS.worlds} worlds"
        table = wait_table(measured("", _WAITS, cache))
        return f"{machine()} {what} with {_WAITS.lanes} lanes:\n\n{table}"
    measured("", _WARM, cache)
    sizes = SMALL if part == "small" else LARGE
    return f"{machine()} In the flow's own process:\n\n{size_table([measured('', size, cache) for size in sizes])}"


def main() -> None:
    """Prints the tables of some parts, or writes them into a document."""
    parser = options(__doc__)
    parser.add_argument("--part", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--child", type=int, nargs=len(Case._fields))
    parser.add_argument("--store", type=Path)
    given = parser.parse_args()
    if given.child:
        run_child(Case(*given.child), given.store)
        return
    with tempfile.TemporaryDirectory(prefix="simyard-scale-cache-") as cache:
        for part in given.part:
            show(f"scale {part}", part_tables(part, Path(cache)), given.document)


if __name__ == "__main__":
    main()
