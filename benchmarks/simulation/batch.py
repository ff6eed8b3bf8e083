"""What a batch costs besides simulating: memory, seconds and bytes for 1,000, 10,000 and 100,000 episodes.

    .venv/bin/python benchmarks/simulation/batch.py [--json FILE] [--episodes N ...]

Each size is a process of its own with a store of its own. The simulator is replaced by one that answers at once: nine
in ten episodes pass, one collides and leaves a trajectory of a minute. Everything else is what a run does: chunks
computed and committed, worlds loaded, results read back, both tables written, the batch described, its jobs listed.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

from pydantic import JsonValue

from benchmarks.repository import ROOT
from specs.data.episode import ApplicationLaunch, EpisodeResult, unfinished_result
from tasks.documents.template_source import find_template
from tasks.results.tables.result_files import write_results
from tasks.simulate.batch.batch_jobs import describe_batch
from tasks.simulate.batch.batch_record import close_batch, complete, load_batch, open_batch
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.simulate.batch.job_lists import list_jobs
from tasks.simulate.batch.result_stream import result_parts
from tasks.simulate.plan.batch_plan import BatchPlan, JobTemplate
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store, encode_document
from tasks.storage.store_url import open_store
from tasks.worlds.generate import generate_world

SIZES = (1_000, 10_000, 100_000)
WORLDS, LANES = 50, 256
DRIVEN = tuple((0.5 * k, 0.01 * k, 0.02 * k, 0.001 * k) for k in range(121))


def simulated(part: ChunkPart) -> list[EpisodeResult]:
    """Returns rows at once; every tenth episode collides."""
    part.watch()
    ended = unfinished_result(0, "Failed", failure_code="", failure_reason="").model_dump()
    rows: list[EpisodeResult] = []
    for request in part.chunk.requests:
        collided = request.index % 10 == 0
        outcome = {"outcome": "Failed", "outcome_reason": "collision", "trajectory": DRIVEN} if collided else {}
        row = {**ended, "status": "Completed", "outcome": "Passed", "simulated_s": 31.4, **outcome}
        rows.append(EpisodeResult.model_validate({**row, "index": request.index, "energy_j": request.index / 7}))
    return rows


def measure(episodes: int, folder: Path) -> dict[str, float]:
    """Returns seconds, bytes and mebibytes of one batch, by name."""
    store = open_store((folder / "store").as_uri())
    plan = planned(store, episodes)
    document: dict[str, JsonValue] = {"createSimulationJobRequests": [_request()]}
    figures = {"MiB before": _peak_mib()}
    batch = load_batch(store, open_batch(store, plan, document, "benchmark").id)
    figures["s chunks"] = _timed(lambda: _all_chunks(batch.layout.chunks, lambda n: run_chunk(
        batch, n, simulated, lanes=LANES, left_s=1e6)))  # fmt: skip
    figures["MiB after chunks"] = _peak_mib()
    complete(batch)
    figures["s tables"] = _timed(
        lambda: write_results(
            store, "out", batch.id, result_parts(batch, "Completed"), variables=plan.variables(), metadata={}
        )
    )
    figures["MiB after tables"] = _peak_mib()
    close_batch(store, batch.id, "Completed", {})
    figures["KiB record"] = len(encode_document(batch.record())) / 1024
    figures["s describe"] = _timed(lambda: describe_batch(store, batch.id))
    figures["s list jobs"] = _timed(lambda: sum(1 for _ in list_jobs(store)))
    figures["MiB at the end"] = _peak_mib()
    return figures


def planned(store: Store, episodes: int) -> BatchPlan:
    """Returns a plan of so many episodes over fifty worlds, which are in the store then."""
    template = find_template("examples/templates/two-rooms.json", store, ROOT)
    world = generate_world(template, seed=7, generation="g", floorplan_index=1, interior_index=1)
    body = world.model_dump_json().encode()
    names = [f"g/w{number}" for number in range(WORLDS)]
    for name in names:
        store.put(world_key(*name.split("/")), body)
    launch = ApplicationLaunch(name="a", version="1", digest="0" * 64, package="p", launch_file="f")
    asked = JobTemplate(robot=launch, scenario=launch, environment={}, duration_s=60.0, failure_behavior="Fail")
    return BatchPlan(
        templates=(asked,),
        worlds=tuple(names),
        seeds=tuple(range(episodes // WORLDS // 2)),
        sweep={"MAX_SPEED": ("0.3", "0.6")},
        lanes=LANES,
        timeout_s=1e6,
        world_digests=dict.fromkeys(names, sha256(body).hexdigest()),
        engine="auto",
    )


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--json", type=Path)
    parser.add_argument("--episodes", type=int, nargs="*", default=SIZES)
    parser.add_argument("--once", type=int)
    options = parser.parse_args()
    if options.once:
        with tempfile.TemporaryDirectory(prefix="simyard-bench-") as folder:
            print(json.dumps(measure(options.once, Path(folder))))
        return
    figures = {
        size: json.loads(subprocess.check_output([sys.executable, __file__, "--once", str(size)], cwd=ROOT))
        for size in options.episodes
    }
    print(f"{'':<20}" + "".join(f"{size:>12,}" for size in figures))
    for name in next(iter(figures.values())):
        print(f"{name:<20}" + "".join(f"{each[name]:>12.2f}" for each in figures.values()))
    if options.json:
        options.json.write_text(json.dumps(figures, indent=2))


def _request() -> JsonValue:
    use: JsonValue = {"application": "arn:simyard:application:0:a", "launchConfig": {"packageName": "p"}}
    return {"maxJobDurationInSeconds": 60, "robotApplications": [use], "simulationApplications": [use]}


def _all_chunks(count: int, run: Callable[[int], object]) -> None:
    for number in range(count):
        run(number)


def _timed(work: Callable[[], object]) -> float:
    start_s = time.perf_counter()
    work()
    return time.perf_counter() - start_s


def _peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
