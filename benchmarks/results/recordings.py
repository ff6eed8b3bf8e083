"""What recordings cost: the same batch without them, with those of failed episodes, and with all of them.

    .venv/bin/python benchmarks/results/recordings.py [--episodes N] [--repeats N] [--rate HZ] [--json FILE]

The shipped applications drive through generated apartments; the three take turns in one process with one compiled
program, so that only what recordings add is compared: samples taken from the device, kept, written and uploaded.
Processor seconds are shown beside wall seconds, since a busy machine changes them less.
"""

import argparse
import json
import resource
import tempfile
import time
from functools import partial
from hashlib import sha256
from pathlib import Path
from statistics import median

from benchmarks.repository import ROOT
from specs.data.episode import ApplicationLaunch, EpisodeResult
from specs.field_types import OutputLocation
from specs.pipeline.simulation_section import Recordings
from tasks.documents.template_source import find_template
from tasks.results.tables.recordings import write_recordings
from tasks.simulate.batch.batch_record import load_batch, open_batch
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.simulate.chunk.runner import simulate_columns
from tasks.simulate.devices import prepare_devices
from tasks.simulate.plan.batch_plan import BatchPlan, JobTemplate
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tasks.worlds.generate import generate_world

WORLDS, LANES = 10, 256
KINDS = ("none", "failed", "all")
FOLDERS = {name * 64: ROOT / "applications" / folder for name, folder in (("c", "courier"), ("d", "delivery"))}
PLACE = OutputLocation(s3Bucket="results")


def run_once(store: Store, plan: BatchPlan, name: str) -> tuple[float, float, int]:
    """Returns wall and processor seconds of a batch's chunks, and how many episodes failed."""
    batch = load_batch(store, open_batch(store, plan, {}, name).id)
    record = partial(write_recordings, store.url, PLACE, batch.id) if plan.records() else None
    failed = 0
    start_s, cpu_s = time.perf_counter(), time.process_time()

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        nonlocal failed
        rows = simulate_columns(
            part.chunk, part.worlds, FOLDERS, lanes=part.lanes, should_stop=lambda: False, recorder=part.recorder
        ).rows()
        failed += sum(row.outcome == "Failed" for row in rows)
        return rows

    for number in range(batch.layout.chunks):
        run_chunk(batch, number, simulate, record, lanes=LANES, left_s=1e6)
    return time.perf_counter() - start_s, time.process_time() - cpu_s, failed


def planned(store: Store, episodes: int, duration_s: float) -> BatchPlan:
    """Returns a plan of so many episodes; its worlds are in the store then."""
    template = find_template("examples/templates/two-rooms.json", store, ROOT)
    digests: dict[str, str] = {}
    for number in range(WORLDS):
        world = generate_world(template, seed=7, generation="g", floorplan_index=number + 1, interior_index=1)
        body = world.model_dump_json().encode()
        store.put(world_key("g", f"w{number}"), body)
        digests[f"g/w{number}"] = sha256(body).hexdigest()
    robot = ApplicationLaunch(name="courier", version="1", digest="c" * 64, package="courier", launch_file="go_to_goal")
    scenario = ApplicationLaunch(name="delivery", version="1", digest="d" * 64, package="delivery", launch_file="rooms")
    asked = JobTemplate(
        robot=robot,
        scenario=scenario,
        environment={"MAX_SPEED": "0.5"},
        duration_s=duration_s,
        failure_behavior="Fail",
    )
    return BatchPlan(
        templates=(asked,),
        worlds=tuple(digests),
        seeds=tuple(range(episodes // WORLDS)),
        sweep={},
        lanes=LANES,
        timeout_s=1e6,
        world_digests=digests,
        engine="auto",
    )


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--episodes", type=int, default=1000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    prepare_devices()
    taken: dict[str, list[tuple[float, float, int]]] = {kind: [] for kind in KINDS}
    with tempfile.TemporaryDirectory(prefix="simyard-bench-") as folder:
        store = open_store((Path(folder) / "store").as_uri())
        plan = planned(store, options.episodes, options.duration)
        run_once(store, plan.model_copy(update={"seeds": (0,)}), "warm-up")
        for turn in range(options.repeats):
            for kind in KINDS:
                recordings = Recordings(episodes=kind, rateHz=options.rate)
                taken[kind].append(run_once(store, plan.model_copy(update={"recordings": recordings}), f"{kind}{turn}"))
        written = sum(path.stat().st_size for path in Path(folder).rglob("recordings/*/*.parquet"))
    base_s, base_cpu_s = (median(each[part] for each in taken["none"]) for part in (0, 1))
    print(f"{options.episodes} episodes of {options.duration:g} s, {options.rate:g} Hz, {taken['none'][0][2]} failed")
    print(f"{'recorded':<10}{'wall s':>8}{'more':>8}{'cpu s':>8}{'more':>8}")
    figures: dict[str, dict[str, float]] = {}
    for kind, turns in taken.items():
        wall_s, cpu_s = (median(each[part] for each in turns) for part in (0, 1))
        figures[kind] = {"wall s": wall_s, "cpu s": cpu_s}
        more = f"{100 * (wall_s / base_s - 1):>7.0f}%{cpu_s:>8.1f}{100 * (cpu_s / base_cpu_s - 1):>7.0f}%"
        print(f"{kind:<10}{wall_s:>8.1f}{more}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{written / 2**20:.1f} MiB written by all, {peak:.0f} MiB of memory at most")
    if options.json:
        options.json.write_text(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
