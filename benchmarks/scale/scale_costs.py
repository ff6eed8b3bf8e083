"""What a batch costs beside its simulation, measured with the code that does it: requests, bytes, rows, task runs.

The plan for many workers (``benchmarks.scale.scale_plan``) rests on these.
"""

import os
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, cast
from unittest.mock import patch

import numpy as np
import yaml

from benchmarks.scale.scale import QUICKSTART, Case, section
from flows.pipeline.references import numbered_finder
from flows.pipeline.tested_batch import batch_plan
from flows.prefect.spread_work import simulate_chunks, write_worlds
from flows.prefect.worker_cluster import Numbers, PieceOutcome, Width, on_workers, spread
from specs.base import canonical_document
from specs.data.episode_columns import EpisodeColumns, RequestColumns
from specs.pipeline.section_requests import generation_request, section_parts, simulation_request
from specs.pipeline.simulation_section import SimulationBatch
from specs.pipeline.world_sections import WorldGeneration
from specs.settings import Workers
from tasks.documents.template_source import find_template
from tasks.results.tables.result_files import write_batch_tables
from tasks.simulate.batch.batch_record import OpenBatch, load_batch, open_batch
from tasks.simulate.batch.chunk_store import counted_columns
from tasks.simulate.batch.result_stream import PART_EPISODES, request_columns
from tasks.simulate.plan.plan_batch import output_location
from tasks.storage.backends.local import LocalStore
from tasks.storage.base.keys import chunk_key, job_key
from tasks.storage.store_url import open_store, store_id
from tasks.worlds.job.generation_job import run_generation_job

# What a method of the store costs on S3, in requests of the dearer and of the cheaper kind.
_WRITES = ("create", "replace", "put", "upload", "keys")
_READS = ("get", "exists", "size", "etag", "mark", "download", "blocks")
_TOKEN = "costs"  # noqa: S105 - of client requests
_ROWS = 100_000
_PIECES = 60
_TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")


class Costs(NamedTuple):
    """What was measured.

    Attributes:
        writes: Requests to S3 that write or list, for a chunk on a worker.
        reads: Requests that read.
        chunk_bytes: What a chunk of 256 episodes leaves in the store.
        record_bytes: The batch's record.
        rows_per_s: Rows of results that one process writes.
        row_bytes: Of the tables, for an episode.
        driver_s: CPU seconds of the flow's process for a piece: to hand it out, and to hear of its end.
        worker_s: Seconds of a worker around a piece: Prefect's task run.
        server_s: CPU seconds of Prefect's server for a task run.
    """

    writes: float
    reads: float
    chunk_bytes: int
    record_bytes: int
    rows_per_s: float
    row_bytes: float
    driver_s: float
    worker_s: float
    server_s: float


def costs(server_pid: int) -> Costs:
    """Returns what this machine measures; a Prefect server is there, and is that process."""
    with tempfile.TemporaryDirectory(prefix="simyard-costs-") as name:
        batch = opened_batch(Path(name), Case(2048))
        counted: Counter[str] = Counter()
        with _counting(counted):
            simulate_some(batch, (0, 1))
            before = counted.copy()
            simulate_some(batch, (2, 3, 4, 5))
        counted.subtract(before)
        rows_per_s, row_bytes = _tables(batch)
        driver_s, worker_s, server_s = _task_runs(server_pid, batch.store.url)
        return Costs(
            writes=sum(counted[name] for name in _WRITES) / 4,
            reads=sum(counted[name] for name in _READS) / 4,
            chunk_bytes=batch.store.size(chunk_key(batch.id, 1)),
            record_bytes=batch.store.size(job_key("simulation-job-batch", batch.id)),
            rows_per_s=rows_per_s,
            row_bytes=row_bytes,
            driver_s=driver_s,
            worker_s=worker_s,
            server_s=server_s,
        )


def opened_batch(folder: Path, case: Case) -> OpenBatch:
    """Returns a batch of short episodes, of which nothing is simulated yet.

    Args:
        folder: A store is made in it.
        case: The batch.
    """
    store = open_store((folder / "store").as_uri())
    document = yaml.safe_load(QUICKSTART.read_text())["worldGeneration"]
    asked = WorldGeneration.model_validate({**document, "worldCount": {"floorplanCount": case.worlds}})
    template = find_template(asked.template, store, QUICKSTART.parent)
    worlds = run_generation_job(
        store,
        generation_request(asked, section_parts(asked)[0], template="arn:simyard:world-template:x:y", token=_TOKEN),
        template,
        seed=asked.seed,
        token=_TOKEN,
        progress=lambda *_: None,
    )
    spec = SimulationBatch.model_validate(section(case))
    plan = batch_plan(spec, cast("list[str]", worlds.detail["worlds"]), store, numbered_finder(store, None))
    request = simulation_request(spec, store_id=store_id(store), token=_TOKEN)
    record = open_batch(store, plan, canonical_document(request), _TOKEN)
    return load_batch(store, record.id)


def simulate_some(batch: OpenBatch, numbers: tuple[int, ...]) -> None:
    """Simulates some chunks of a batch."""
    location = output_location(SimulationBatch.model_validate(section(Case(2048))))
    simulate_chunks.fn(
        batch.store.url,
        batch.id,
        numbers,
        location=location,
        left_s=3600.0,
        spent_s=0.0,
        authenticator=batch.authenticator,
    )


@contextmanager
def _counting(counted: Counter[str]) -> Generator[None]:
    """Counts the calls of the store's methods inside the ``with`` block."""
    with ExitStack() as patches:
        for name in (*_WRITES, *_READS):
            patches.enter_context(patch.object(LocalStore, name, _counted(name, counted)))
        yield


def _counted(name: str, counted: Counter[str]) -> Callable[..., object]:
    original = getattr(LocalStore, name)

    def call(*given: object, **named: object) -> object:
        counted[name] += 1
        return original(*given, **named)

    return call


def _tables(batch: OpenBatch) -> tuple[float, float]:
    """Returns how many rows of some chunks, taken again and again, are written in a second, and the bytes of one.

    A chunk is read, vouched for and decoded each time that it is taken.
    """
    lanes = batch.plan.lanes
    chunks = range(_ROWS // lanes)

    def parts() -> Generator[tuple[RequestColumns, EpisodeColumns]]:
        for first in range(0, len(chunks), PART_EPISODES // lanes):
            numbers = chunks[first : first + PART_EPISODES // lanes]
            found = [counted_columns(batch.store, batch.id, number % 6, batch.authenticator) for number in numbers]
            results = EpisodeColumns.join([each for each in found if each is not None])
            index = first * lanes + np.arange(len(results))
            asked = request_columns(batch.layout, 0, 6 * lanes).take(index % (6 * lanes))
            yield replace(asked, index=index), results.renumbered(index)

    location = output_location(SimulationBatch.model_validate(section(Case(2048))))
    start_s = time.perf_counter()
    write_batch_tables(batch.store, batch.id, parts(), variables=batch.plan.variables(), location=location, metadata={})
    took_s = time.perf_counter() - start_s
    written = Path(batch.store.url.removeprefix("file://")).glob("buckets/results/**/*.parquet")
    rows = len(chunks) * lanes
    return rows / took_s, sum(file.stat().st_size for file in written) / rows


def _task_runs(server_pid: int, store_url: str) -> tuple[float, float, float]:
    """Returns CPU seconds of the driver, seconds of a worker, and CPU seconds of the server, for a task run."""
    figures: list[tuple[float, float, float]] = []

    def work(width: Width) -> None:
        at = time.perf_counter(), time.process_time(), _cpu_s(server_pid)
        # Pieces of one: a number that takes no time at all would have all others follow in one piece.
        for _ in range(_PIECES):
            spread(
                [0],
                lambda _: write_worlds.submit(store_url, "nothing", [], ()),
                width=width,
                going=_always,
                missing=_none,
                on_end=_on_end,
            )
        now = time.perf_counter(), time.process_time(), _cpu_s(server_pid)
        figures.append(tuple((after - before) / _PIECES for after, before in zip(now, at, strict=True)))  # pyright: ignore[reportArgumentType]

    on_workers(Workers(kind="dask", count=1), "nothings", "nothings", work)
    ((worker_s, driver_s, server_s),) = figures
    return driver_s, worker_s, server_s


def _always() -> bool:
    return True


def _none(numbers: Numbers) -> Numbers:
    return numbers[:0]


def _on_end(end: PieceOutcome) -> float:
    if end.failure:
        raise RuntimeError(end.failure)
    return 1.0


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS_A_SECOND
