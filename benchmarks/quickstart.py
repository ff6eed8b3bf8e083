"""How long the quickstart takes, stage by stage, with nothing cached and with everything cached.

    .venv/bin/python benchmarks/quickstart.py [--json FILE] [--warm-runs N]

Each run is a process of its own with a new store. `cold` has an empty cache folder (no compiled programs, no Prefect
database, no unpacked bundles); the warm runs share the cache that the cold one left. What counts as Prefect: importing
it, waiting for its server beyond the imports of JAX and MJX, what flows and tasks take beyond the work of the jobs that
they run, and ending the server.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

from benchmarks.repository import ROOT
from flows.server.prefect_server import prefect_home
from specs.job_kinds import JobKind
from tasks.documents.pipeline_file import read_pipeline
from tasks.server.process import run_server, wait_until_healthy
from tasks.simulate.devices import prepare_devices
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import records
from tasks.storage.store_url import open_store

DOCUMENT = ROOT / "examples/quickstart.yaml"
JOBS: Mapping[JobKind, str] = {
    "world-generation-job": "worldGeneration",
    "world-export-job": "worldExport",
    "simulation-job-batch": "simulationBatch",
    "deployment-job": "deployment",
}


def measure_once(store_url: str) -> dict[str, float]:
    """Returns the seconds of each phase of one run in this process, by name."""
    start_s = time.perf_counter()
    spec = read_pipeline(DOCUMENT)
    store = open_store(store_url)
    home = prefect_home()
    phases = {"read document": time.perf_counter() - start_s}
    with run_server(home) as (server, child):
        os.environ.update(server.environment(), PREFECT_HOME=str(home))
        phases["import jax, mjx"] = _timed(lambda: (prepare_devices(), import_module("tasks.simulate.chunk.episodes")))
        phases["import prefect"] = _timed(lambda: import_module("flows.pipeline"))
        phases["wait for server"] = _timed(lambda: wait_until_healthy(server, child))
        pipeline = import_module("flows.pipeline").pipeline
        phases["pipeline flow"] = _timed(lambda: pipeline(spec, store=store.url, base=str(DOCUMENT.parent)))
        from flows.server.unsent_events import flush_prefect  # noqa: PLC0415 - only once Prefect is loaded anyway

        phases["flush logs"] = _timed(flush_prefect)
        ending_s = time.perf_counter()
    phases["end server"] = time.perf_counter() - ending_s
    return {**phases, **_work(store)}


def _work(store: Store) -> dict[str, float]:
    return {
        name: sum(job.updated_at_s - job.created_at_s for job in records(store, kind)) for kind, name in JOBS.items()
    }


def _timed(work: Callable[[], object]) -> float:
    start_s = time.perf_counter()
    work()
    return time.perf_counter() - start_s


def run_once(cache: Path) -> dict[str, float]:
    """Returns the phases of a run in a process of its own, with its wall time."""
    with tempfile.TemporaryDirectory(prefix="simyard-bench-") as folder:
        environment = {
            key: value for key, value in os.environ.items() if key not in {"PREFECT_API_URL", "PREFECT_HOME"}
        }
        environment |= {"SIMYARD_CACHE": str(cache), "PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL": "CRITICAL"}
        command = [
            sys.executable,
            __file__,
            "--once",
            (Path(folder) / "store").as_uri(),
            "--json",
            f"{folder}/phases.json",
        ]
        start_s = time.perf_counter()
        subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
        wall_s = time.perf_counter() - start_s
        phases = json.loads((Path(folder) / "phases.json").read_text())
    work_s = sum(phases[name] for name in JOBS.values())
    prefect = ("import prefect", "wait for server", "flush logs", "end server")
    phases["of which Prefect"] = phases["pipeline flow"] - work_s + sum(phases[name] for name in prefect)
    phases["wall"] = wall_s
    return phases


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--json", type=Path)
    parser.add_argument("--once")
    parser.add_argument("--warm-runs", type=int, default=3)
    options = parser.parse_args()
    if options.once:
        options.json.write_text(json.dumps(measure_once(options.once)))
        return
    with tempfile.TemporaryDirectory(prefix="simyard-cache-") as cache:
        runs = {"cold": run_once(Path(cache))}
        runs |= {f"warm {number + 1}": run_once(Path(cache)) for number in range(options.warm_runs)}
    print(f"{'seconds':<20}" + "".join(f"{name:>10}" for name in runs))
    for phase in runs["cold"]:
        print(f"{phase:<20}" + "".join(f"{run[phase]:>10.1f}" for run in runs.values()))
    if options.json:
        options.json.write_text(json.dumps(runs, indent=2))


if __name__ == "__main__":
    main()
