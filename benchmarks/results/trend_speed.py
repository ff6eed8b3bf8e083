"""How long `simyard trend` takes for a thousand nights, from real tables in a store.

    .venv/bin/python -m benchmarks.results.trend_speed [--nights N] [--store URL] [--json FILE]

Each night is a run and a batch with their records and a ``results.parquet`` of 384 made-up episodes. The first command
reads all of them, the second one finds them in the cache folder.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from pydantic import JsonValue

from benchmarks.machine import machine
from benchmarks.results.report import ROBOT, SCENARIO, SPEEDS, parts
from benchmarks.tables import markdown
from tasks.results.tables.result_files import write_batch_tables
from tasks.simulate.batch.batch_record import KIND, load_batch, open_batch
from tasks.simulate.batch.provenance import seal
from tasks.simulate.plan.batch_plan import BatchPlan, JobTemplate
from tasks.simulate.plan.plan_batch import DEFAULT_OUTPUT
from tasks.storage.base.store import Store
from tasks.storage.buckets import bucket_url
from tasks.storage.jobs.records import advance, submit
from tasks.storage.jobs.runs import stage_token
from tasks.storage.store_url import open_store

EPISODES, WORLDS = 384, 8
_LAUNCH: dict[str, JsonValue] = {"packageName": "p", "launchFile": "f"}
_JOB: dict[str, JsonValue] = {
    "maxJobDurationInSeconds": 60,
    "robotApplications": [{"application": "arn:simyard:robot-application:0:courier", "launchConfig": _LAUNCH}],
    "simulationApplications": [{"application": "arn:simyard:simulation-application:0:d", "launchConfig": _LAUNCH}],
}
REQUEST: dict[str, JsonValue] = {"createSimulationJobRequests": [_JOB]}


def store_night(store: Store, number: int) -> None:
    """Puts a night into a store: its run, its batch and that one's tables."""
    identity: dict[str, JsonValue] = {
        "flow": "pipeline",
        "spec": {"name": "nightly", "simulationBatch": {}, "worldGeneration": {}},
        "pins": {"batch": number},
    }
    run = submit(store, "pipeline-run", identity, f"night-{number}")
    names = [f"wgj-{number}/world-{world}" for world in range(WORLDS)]
    robot = ROBOT.model_copy(update={"version": str(number), "digest": f"{number:064x}"})
    template = JobTemplate(robot=robot, scenario=SCENARIO, environment={}, duration_s=60.0, failure_behavior="Fail")
    plan = BatchPlan(
        templates=(template,),
        worlds=tuple(names),
        seeds=tuple(range(EPISODES // WORLDS // len(SPEEDS))),
        sweep={"MAX_SPEED": SPEEDS},
        lanes=256,
        timeout_s=100.0,
        world_digests=dict.fromkeys(names, "e" * 64),
        engine="auto",
    )
    record = open_batch(store, plan, REQUEST, stage_token(run, "batch"))
    batch = load_batch(store, record.id)
    made = ((asked, answered) for asked, answered in parts(EPISODES, names, 0.05))
    detail, _ = write_batch_tables(
        store, record.id, made, variables={"MAX_SPEED": SPEEDS}, location=DEFAULT_OUTPUT, metadata={}
    )
    advance(store, KIND, record.id, "Completed", detail={**detail, **seal(batch, detail)})
    advance(store, "pipeline-run", run.id, "Completed")


def commands(store: Store, cache: Path) -> Iterator[tuple[str, float]]:
    """Yields what is done, and the seconds that the whole command takes."""
    environment = {**os.environ, "SIMYARD_CACHE": str(cache), "SIMYARD_STORE": store.url}
    page = str(cache / "trend.html")
    for what, more in (("all tables read", ["--anew"]), ("all tables read again", ["--anew"]), ("from the cache", [])):
        start_s = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-m", "flows.cli.shell", "trend", "nightly", "--output", page, *more],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise RuntimeError(done.stderr)
        yield what, time.perf_counter() - start_s


def main() -> None:
    """Prints the table, and writes it as JSON if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--nights", type=int, default=1_000)
    parser.add_argument("--store", help="a new one in a temporary folder by default")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="simyard-benchmark-") as folder:
        os.environ["SIMYARD_CACHE"] = str(Path(folder) / "cache")
        store = open_store(options.store or (Path(folder) / "store").as_uri())
        Path(folder, "store", "buckets", DEFAULT_OUTPUT.s3Bucket or "").mkdir(parents=True, exist_ok=True)
        for number in range(options.nights):
            store_night(store, number)
        found = list(commands(store, Path(folder) / "cache"))
        print(machine(), bucket_url(store, DEFAULT_OUTPUT.s3Bucket or "").partition("://")[0])
    print(markdown([[f"{options.nights:,} nights", "seconds"], *([what, f"{taken:.1f}"] for what, taken in found)]))
    if options.json:
        options.json.write_text(json.dumps(dict(found), indent=1))


if __name__ == "__main__":
    main()
