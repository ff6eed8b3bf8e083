"""How long the report of a large batch takes, and how large it is.

    .venv/bin/python benchmarks/results/report.py [--rows N ...] [--worlds N] [--failing SHARE] [--json FILE]

Rows are made up: robots wander through generated apartments for a minute, a share of them fails, and every failure
leaves the longest trajectory that there is. Tables, worlds and page go through a store in a folder, as in a batch.
"""

import argparse
import json
import resource
import tempfile
import time
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

import numpy as np

from benchmarks.machine import machine
from benchmarks.repository import ROOT
from benchmarks.tables import markdown
from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.field_types import OutputLocation
from tasks.documents.template_source import find_template
from tasks.results.report.batch_facts import BatchFacts, Judgement
from tasks.results.report.report_page import batch_view, put_report, report_page
from tasks.results.tables.result_files import EpisodePart, write_results
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import open_store
from tasks.worlds.generate import generate_world

PLACE = OutputLocation(s3Bucket="results")
ROBOT = ApplicationLaunch(name="courier", version="1", digest="c" * 64, package="courier", launch_file="go_to_goal")
SCENARIO = ApplicationLaunch(name="delivery", version="1", digest="d" * 64, package="delivery", launch_file="rooms")
REASONS = ("collision", "timeout", "stuck", "out of bounds")
SPEEDS = ("0.3", "0.4", "0.5", "0.6")
PART, POSES = 2048, 121


def stored_worlds(store: Store, count: int) -> dict[str, str]:
    """Returns the digests of generated worlds; there are ten, each as often as needed under other names."""
    template = find_template("examples/templates/two-rooms.json", store, ROOT)
    bodies = [
        generate_world(template, seed=7, generation="g", floorplan_index=number + 1, interior_index=1)
        .model_dump_json()
        .encode()
        for number in range(min(10, count))
    ]
    digests: dict[str, str] = {}
    for number in range(count):
        body = bodies[number % len(bodies)]
        store.put(world_key("g", f"w{number}"), body)
        digests[f"g/w{number}"] = sha256(body).hexdigest()
    return digests


def parts(rows: int, worlds: list[str], failing: float) -> Iterator[EpisodePart]:
    """Yields made-up episodes."""
    rng = np.random.default_rng(7)
    for first in range(0, rows, PART):
        indices = range(first, min(rows, first + PART))
        fails = rng.random(len(indices)) < failing
        steps = rng.normal(0.0, 0.08, (len(indices), POSES, 2)).cumsum(axis=1).round(4)
        yield (
            [request(index, worlds[index % len(worlds)]) for index in indices],
            [result(index, steps[row] if fails[row] else None, steps[row, -1]) for row, index in enumerate(indices)],
        )


def request(index: int, world: str) -> EpisodeRequest:
    """Returns what one episode was asked for."""
    return EpisodeRequest(
        index=index,
        world=world,
        seed=index,
        robot=ROBOT,
        scenario=SCENARIO,
        environment={"MAX_SPEED": SPEEDS[index // 7 % len(SPEEDS)]},
        duration_s=60.0,
    )


def result(index: int, way_m: np.ndarray | None, end_m: np.ndarray) -> EpisodeResult:
    """Returns what came of one episode, which failed if there is a way."""
    passed = way_m is None
    x, y = float(end_m[0]), float(end_m[1])
    return EpisodeResult(
        index=index,
        status="Completed",
        failure_code="",
        failure_reason="",
        outcome="Passed" if passed else "Failed",
        outcome_reason="" if passed else REASONS[index % 13 % len(REASONS)],
        simulated_s=60.0,
        goals_reached=2 if passed else 1,
        goals_total=2,
        path_length_m=10.0,
        shortest_path_m=8.0,
        spl=0.8 if passed else 0.0,
        collisions=0,
        min_clearance_m=0.1,
        energy_j=40.0,
        final_x_m=x,
        final_y_m=y,
        final_yaw_rad=0.0,
        trajectory=() if way_m is None else tuple((0.5 * i, float(a), float(b), 0.0) for i, (a, b) in enumerate(way_m)),
    )


def facts(worlds: dict[str, str], rows: int) -> BatchFacts:
    """Returns what records would say of the batch."""
    return BatchFacts(
        batch="simb-0",
        arn="arn:simyard:simulation-job-batch:0123456789ab:simb-0",
        store="0123456789ab",
        name="report-benchmark",
        status="Completed",
        why="",
        created_at_s=0.0,
        simulated_s=60.0 * rows,
        seeds=rows // len(worlds),
        worlds=worlds,
        variables={"MAX_SPEED": SPEEDS},
        robots=(ROBOT,),
        simulations=(SCENARIO,),
        metadata={"engine": "planar", "device": "cpu", "lanes": "256"},
        judgement=Judgement(verdict="FAIL", sentence="FAIL: made up", at_least=0.9, confidence=0.95),
    )


def measured(rows: int, worlds: int, failing: float) -> dict[str, float]:
    """Returns the seconds, the page's bytes, and the bytes of both tables."""
    with tempfile.TemporaryDirectory(prefix="simyard-benchmark-") as folder:
        store = open_store(Path(folder).as_uri())
        known = facts(stored_worlds(store, worlds), rows)
        made = parts(rows, list(known.worlds), failing)
        bucket = open_bucket(store, "results")
        write_results(bucket, None, known.batch, made, variables={"MAX_SPEED": SPEEDS}, metadata={})
        start_s = time.perf_counter()
        page = report_page(batch_view(store, known, PLACE))
        put_report(store, PLACE, known.batch, page)
        seconds = time.perf_counter() - start_s
        tables = sum(file.stat().st_size for file in Path(folder).rglob("*.parquet"))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return {"rows": rows, "worlds": worlds, "seconds": seconds, "page": len(page), "tables": tables, "peak": peak}


def main() -> None:
    """Prints the table, and writes it as JSON if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rows", type=int, nargs="+", default=[1_000, 10_000, 100_000])
    parser.add_argument("--worlds", type=int, default=100)
    parser.add_argument("--failing", type=float, default=0.3)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    found = [measured(rows, arguments.worlds, arguments.failing) for rows in sorted(arguments.rows)]
    table = [["rows", "worlds", "report, s", "page, kB", "tables, MB", "peak memory, MB"]]
    table += [
        [
            f"{each['rows']:,}",
            f"{each['worlds']:,}",
            f"{each['seconds']:.1f}",
            f"{each['page'] / 1e3:,.0f}",
            f"{each['tables'] / 1e6:,.1f}",
            f"{each['peak'] / 1e6:,.0f}",
        ]
        for each in found
    ]
    print(machine())
    print(markdown(table))
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
