"""How fast worlds are written in each format, what that takes of memory, and how long an upload takes.

    .venv/bin/python -m benchmarks.export.export [--repeats N] [--s3] [--document docs/guide/export.md]

The worlds are of two templates in turn, generated beforehand. Formats take turns, and medians are shown. Memory is
measured in a process of its own for each size: the peak beyond what it had before the first world was written.
``--s3`` uploads a zip of 100 worlds in all formats to a SeaweedFS of this machine.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median

from benchmarks.harness import machine, markdown, options, show
from benchmarks.worlds.world_templates import read_template
from specs.data.world import World
from specs.pipeline.world_sections import FORMATS, WorldFormat
from tasks.export.job.world_files import write_zip
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import open_store
from tasks.worlds.generate import generate_world

TEMPLATES = ("two-rooms", "one-bedroom-house")
TIMED_WORLDS = 20
SIZES = (1, 10, 100)
ALL = "all"


def worlds(count: int) -> Iterator[World]:
    """Yields worlds, each made when it is asked for."""
    for number in range(count):
        template = read_template(TEMPLATES[number % len(TEMPLATES)])
        yield generate_world(
            template, seed=number, generation="wgj-benchmark", floorplan_index=number + 1, interior_index=1
        )


def chosen(name: str) -> Sequence[WorldFormat]:
    """Returns the formats of a name, which may be ``all``."""
    return FORMATS if name == ALL else [each for each in FORMATS if each == name]


def speeds(repeats: int) -> list[list[str]]:
    """Returns a table of worlds and megabytes a second by format."""
    made = list(worlds(TIMED_WORLDS))
    found: dict[str, list[tuple[float, int]]] = {name: [] for name in (*FORMATS, ALL)}
    with tempfile.TemporaryDirectory(prefix="simyard-export-") as folder:
        target = Path(folder) / "worlds.zip"
        for repeat in range(repeats + 1):
            for name, times in found.items():
                start_s = time.perf_counter()
                write_zip(made, chosen(name), target)
                if repeat:  # the first turn imports libraries and draws textures
                    times.append((time.perf_counter() - start_s, target.stat().st_size))
    table = [["format", "worlds/s", "zipped MB/s", "zipped KB a world"]]
    for name, times in found.items():
        took_s, size = median(took_s for took_s, _ in times), times[0][1]
        rate = f"{TIMED_WORLDS / took_s:,.1f}"
        table.append([name, rate, f"{size / took_s / 1e6:.2f}", f"{size / TIMED_WORLDS / 1e3:,.0f}"])
    return table


def memory() -> list[list[str]]:
    """Returns a table of what zips of several sizes take of memory, all formats."""
    table = [["worlds in the zip", "peak beyond the start, MB", "zip, MB"]]
    for size in SIZES:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.export.export", "--one", str(size)],
            check=True,
            capture_output=True,
            text=True,
        )
        peak_mb, zip_mb = json.loads(done.stdout)
        table.append([str(size), f"{peak_mb:,.0f}", f"{zip_mb:,.1f}"])
    return table


def one(size: int) -> list[float]:
    """Returns peak memory beyond the start, and the size of the zip, both in megabytes; for a process of its own."""
    with tempfile.TemporaryDirectory(prefix="simyard-export-") as folder:
        target = Path(folder) / "worlds.zip"
        write_zip(worlds(1), FORMATS, target)  # imports are not what grows with the worlds
        before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        write_zip(worlds(size), FORMATS, target)
        return [(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb) / 1e3, target.stat().st_size / 1e6]


def uploads(repeats: int) -> list[list[str]]:
    """Returns a table of how long a zip of 100 worlds takes to a folder and to SeaweedFS, verified."""
    from tests.servers.seaweed import running_seaweed  # noqa: PLC0415 - only here

    table = [["zip of 100 worlds", "MB", "s", "MB/s"]]
    with tempfile.TemporaryDirectory(prefix="simyard-export-") as folder:
        target = Path(folder) / "worlds.zip"
        write_zip(worlds(100), FORMATS, target)
        size_mb = target.stat().st_size / 1e6
        store = open_store((Path(folder) / "store").as_uri())
        (Path(folder) / "weed").mkdir()
        with running_seaweed(Path(folder) / "weed") as seaweed:
            seaweed.make_bucket("worlds")
            os.environ.update(seaweed.environment())
            for place, buckets in (("folder", ""), ("SeaweedFS", "s3://")):
                os.environ["SIMYARD_BUCKETS"] = buckets or (Path(folder) / "buckets").as_uri()
                bucket = open_bucket(store, "worlds")
                times: list[float] = []
                for number in range(repeats):
                    start_s = time.perf_counter()
                    bucket.upload(f"{number}.zip", target)
                    times.append(time.perf_counter() - start_s)
                table.append([place, f"{size_mb:,.1f}", f"{median(times):.2f}", f"{size_mb / median(times):,.0f}"])
    return table


def main() -> None:
    """Measures and shows."""
    parser = options(__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--s3", action="store_true")
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        sys.stdout.write(json.dumps(one(given.one)))
        return
    tables = [markdown(speeds(given.repeats)), markdown(memory())]
    if given.s3:
        tables.append(markdown(uploads(given.repeats)))
    text = "\n\n".join([f"{machine()}, medians of {given.repeats}:", *tables])
    show("export", text, given.document)


if __name__ == "__main__":
    main()
