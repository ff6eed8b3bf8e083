"""Spreads a batch's chunks, the making and the export of worlds, and a search's episodes over the workers of a cluster.

Chunks are the same as on one machine, and whoever simulates one commits it, so that the tables are the same bytes. So
are a search's answers, for an episode has the same bits whatever is simulated beside it.
"""

import functools
import os
import platform
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple

from prefect import task
from prefect.futures import PrefectFuture

from flows.batch.batch_steps import EPISODES, simulate_chunk
from flows.batch.replay_episode import unpacked
from flows.batch.search_batch import STAGE, SearchResult, SearchWorkers
from flows.batch.search_episodes import DriveEpisodes, drive_episodes, is_canceled, shared_out
from flows.prefect.prefect_events import announce_changes
from flows.prefect.tasks import TASK_OPTIONS, named_by, show_progress, show_search
from flows.prefect.worker_cluster import Numbers, PieceOutcome, Width, on_workers, spread, wanted_workers
from specs.data.episode import EpisodeRequest, EpisodeResult
from specs.errors import StageFailed
from specs.field_types import OutputLocation
from specs.job_kinds import JobKind
from specs.pipeline.world_sections import WorldFormat
from specs.settings import Workers
from tasks.export.job import export_job as exporting
from tasks.export.job.world_files import kept_parts, make_parts
from tasks.progress.listener import Progress
from tasks.simulate.batch.batch_record import GOING, STOPPING, OpenBatch, load_batch, time_out
from tasks.simulate.batch.chunk_run import chunks_ahead, forget_chunks
from tasks.simulate.batch.chunk_store import chunk_numbers, spent_s, stored_chunk
from tasks.simulate.batch.metrics import BatchMeter, BatchMetrics, ChunkWork
from tasks.simulate.batch.provenance import note_machine
from tasks.simulate.batch.result_stream import give_up
from tasks.storage.base.store import Store
from tasks.storage.jobs.authenticator import BatchAuthenticator
from tasks.storage.jobs.records import read
from tasks.storage.store_url import open_store
from tasks.worlds.job import generation_job as generating
from tasks.worlds.job.generation_job import make_and_keep, missing_worlds
from tasks.worlds.job.production import Indices, Order, WorldOutcome

# Below, one machine is done by the time that workers have come up and imported what they need.
WORTH_MAKING = 100
_WORTH_WRITING = 40
_LOOK_EVERY_S = 1.0
_GOING = frozenset({"Pending", "Running"})


class WorldsDone(NamedTuple):
    """What a worker could not make, and the seconds that it took over its piece."""

    rejected: list[WorldOutcome]
    wall_s: float


def world_makers(store: Store) -> generating.RemoteWorldMaker | None:
    """Returns what hands worlds to workers, if SIMYARD_WORKERS names some; None where this process makes them.

    Raises:
        DocumentError: It names none that there are.
    """
    workers = wanted_workers()

    def make(
        order: Order, indices: Sequence[Indices], *, going: Callable[[], bool], done: Callable[[int], None]
    ) -> Mapping[Indices, WorldOutcome]:
        rejected: dict[Indices, WorldOutcome] = {}
        if workers is None or len(indices) < WORTH_MAKING:
            return rejected
        order_json = order.model_dump_json(exclude_unset=True)  # a template does not survive being pickled

        def hand_out(numbers: Numbers) -> PrefectFuture[Any]:
            return make_worlds.with_options(task_run_name=_piece("worlds", numbers)).submit(
                store.url, order_json, [indices[number] for number in numbers]
            )

        def missing(numbers: Numbers) -> Numbers:
            absent = set(missing_worlds(store, order.generation, [indices[number] for number in numbers]))
            return tuple(number for number in numbers if indices[number] in absent)

        def on_end(end: PieceOutcome) -> float:
            rejected.update({each.indices: each for each in end.result.rejected})
            done(len(end.numbers))
            return end.result.wall_s

        def worlds(width: Width) -> None:
            numbers = range(len(indices))
            spread(numbers, hand_out, width=width, going=going, missing=missing, on_end=on_end)

        on_workers(workers, "worlds", order.generation, worlds)
        return rejected

    return make if workers else None


def world_writers(store: Store) -> exporting.ExportWorkers | None:
    """Returns what hands exported worlds to workers, if SIMYARD_WORKERS names some; None where none are wanted.

    Raises:
        DocumentError: It names none that there are.
    """
    workers = wanted_workers()

    def write(
        job: str,
        references: Sequence[str],
        formats: Collection[WorldFormat],
        *,
        going: Callable[[], bool],
        done: Callable[[int], None],
    ) -> None:
        kept = kept_parts(store, job)
        wanted = [each for each in references if each not in kept]
        if workers is None or len(wanted) < _WORTH_WRITING:
            return

        def hand_out(numbers: Numbers) -> PrefectFuture[Any]:
            return write_worlds.with_options(task_run_name=_piece("export worlds", numbers)).submit(
                store.url, job, [wanted[number] for number in numbers], tuple(formats)
            )

        def missing(numbers: Numbers) -> Numbers:
            there = kept_parts(store, job)
            return tuple(number for number in numbers if wanted[number] not in there)

        def on_end(end: PieceOutcome) -> float:
            done(len(end.numbers))
            return end.result.wall_s

        def parts(width: Width) -> None:
            numbers = range(len(wanted))
            spread(numbers, hand_out, width=width, going=going, missing=missing, on_end=on_end)

        done(len(kept))
        on_workers(workers, "world-files", job, parts)

    return write if workers else None


@task(name="make-worlds", **TASK_OPTIONS)
def make_worlds(store_url: str, order_json: str, indices: list[Indices]) -> WorldsDone:
    """Returns the worlds of a piece that cannot be, having kept the others; runs on a worker, maybe another machine.

    Args:
        store_url: Where worlds lie.
        order_json: What the worlds have in common, as JSON.
        indices: Floor plan and interior of each world.
    """
    start_s, store, order = time.monotonic(), open_store(store_url), Order.model_validate_json(order_json)
    rejected = make_and_keep(store, order, indices, _going_check(store, generating.KIND, order.generation))
    return WorldsDone(rejected, time.monotonic() - start_s)


@task(name="write-worlds", **TASK_OPTIONS)
def write_worlds(store_url: str, job: str, references: list[str], formats: tuple[WorldFormat, ...]) -> WorldsDone:
    """Returns how long it took to keep what the worlds of a piece become; runs on a worker, maybe another machine.

    Args:
        store_url: Where worlds lie, and what they become is kept.
        job: The export job.
        references: ``<generation>/<world>`` of each world.
        formats: What each is written as.
    """
    start_s, store = time.monotonic(), open_store(store_url)
    make_parts(store, job, references, formats, _going_check(store, exporting.KIND, job))
    return WorldsDone([], time.monotonic() - start_s)


def _piece(what: str, numbers: Numbers) -> str:
    """Returns what Prefect's pages call the task run of a piece, such as ``worlds 1-8``."""
    return f"{what} {numbers[0] + 1}-{numbers[-1] + 1}"


def _going_check(store: Store, kind: JobKind, job: str) -> Callable[[], bool]:
    """Returns a function that says whether a job goes on, and reads its record at most once a second."""
    looked_s, going = -_LOOK_EVERY_S, True

    def look() -> bool:
        nonlocal looked_s, going
        if time.monotonic() - looked_s >= _LOOK_EVERY_S:
            looked_s, going = time.monotonic(), read(store, kind, job).status in _GOING
        return going

    return look


class ChunksDone(NamedTuple):
    """What a worker did: episodes of the chunks that it came to, the seconds that it took, and what they went into."""

    episodes: int
    wall_s: float
    work: ChunkWork = ChunkWork()
    worker: str = ""


def spread_batch(batch: OpenBatch, location: OutputLocation, workers: Workers) -> BatchMetrics | None:
    """Commits all chunks of a batch, or those before it is cancelled or its time is over; returns its speed.

    Raises:
        StageFailed: A chunk was lost several times.
    """
    meter = BatchMeter()

    def episodes(width: Width) -> None:
        with show_progress(EPISODES, "episodes-progress") as progress:
            work = _SpreadBatch(batch, location, progress, meter)
            spread(
                work.left,
                work.hand_out,
                width=width,
                going=work.going,
                missing=work.missing,
                on_end=work.on_end,
            )
            progress(work.done, batch.layout.episodes)

    on_workers(workers, "episodes", batch.id, episodes)
    if batch.record().status in STOPPING:
        give_up(batch)  # the chunks of workers that are gone; a worker that comes back is too late
    return meter.metrics()


class _SpreadBatch:
    """A batch that is being handed out."""

    def __init__(self, batch: OpenBatch, location: OutputLocation, progress: Progress, meter: BatchMeter) -> None:
        committed = [
            number for number in chunk_numbers(batch.store, batch.id).committed if _is_authentic(batch, number)
        ]
        self.left = [number for number in range(batch.layout.chunks) if number not in committed]
        self.done = sum(map(batch.layout.chunk_size, committed))
        self._batch, self._location, self._progress, self._meter = batch, location, progress, meter
        self._before_s, self._start_s = spent_s(batch.store, batch.id), time.monotonic()

    def hand_out(self, numbers: Numbers) -> PrefectFuture[Any]:
        batch, worked_s = self._batch, self._worked_s()
        return simulate_chunks.submit(
            batch.store.url,
            batch.id,
            numbers,
            location=self._location,
            left_s=batch.plan.timeout_s - worked_s,
            spent_s=worked_s,
            authenticator=self._batch.authenticator,
        )

    def going(self) -> bool:
        """Returns whether more chunks are wanted; workers find the batch's end in its record, too."""
        over = self._worked_s() >= self._batch.plan.timeout_s
        now = time_out(self._batch) if over else self._batch.record()
        return now.status in GOING

    def missing(self, numbers: Numbers) -> Numbers:
        return tuple(number for number in numbers if not _is_authentic(self._batch, number))

    def on_end(self, end: PieceOutcome) -> float:
        piece: ChunksDone = end.result
        self.done += piece.episodes
        self._meter.add(piece.work, piece.worker)
        self._progress(self.done, self._batch.layout.episodes)
        return piece.wall_s

    def _worked_s(self) -> float:
        return self._before_s + time.monotonic() - self._start_s


def chunks_name(parameters: Mapping[str, Any]) -> str:
    """Returns what Prefect's pages call the task run of some chunks, such as ``chunks 3-5``."""
    first, last = parameters["numbers"][0] + 1, parameters["numbers"][-1] + 1
    return f"chunk {first}" if first == last else f"chunks {first}-{last}"


@task(
    name="simulate-chunks",
    task_run_name=named_by(chunks_name),
    **TASK_OPTIONS,
)
def simulate_chunks(
    store_url: str,
    batch: str,
    numbers: Numbers,
    *,
    location: OutputLocation,
    left_s: float,
    spent_s: float,
    authenticator: BatchAuthenticator,
) -> ChunksDone:
    """Returns what was done of some chunks, one after the other; runs on a worker, which may be another machine.

    Args:
        store_url: Where the batch's record, worlds, bundles and chunks are.
        batch: The batch's id.
        numbers: The chunks'.
        location: The batch's output location.
        left_s: Wall seconds that the batch has left.
        spent_s: Wall seconds that were spent on the batch before.
        authenticator: Authenticates the results, under a key of the batch that the store does not have.
    """
    with announce_changes():  # a worker may be the first to see that time is up
        return _simulate_numbers(
            load_batch(open_store(store_url), batch, authenticator), numbers, location, left_s=left_s, spent_s=spent_s
        )


def _simulate_numbers(
    work: OpenBatch, numbers: Numbers, location: OutputLocation, *, left_s: float, spent_s: float
) -> ChunksDone:
    store_url, batch = work.store.url, work.id
    start_s, episodes, done = time.monotonic(), 0, ChunkWork()
    note_machine(work)
    lanes = work.plan.lanes
    try:
        for place, number in enumerate(numbers):
            if work.record().status not in GOING:
                break
            took_s = time.monotonic() - start_s
            ended = simulate_chunk(
                store_url,
                batch,
                number,
                location=location,
                lanes=lanes,
                left_s=left_s - took_s,
                spent_s=spent_s + took_s,
                ahead=chunks_ahead(numbers[place + 1 :]),
                authenticator=work.authenticator,
            )
            lanes, episodes, done = ended.lanes, episodes + ended.episodes, done.plus(ended.work)
    finally:
        forget_chunks(work)
    return ChunksDone(episodes, time.monotonic() - start_s, done, f"{platform.node()} {os.getpid()}")


def _is_authentic(batch: OpenBatch, number: int) -> bool:
    found = stored_chunk(batch.store, batch.id, number, batch.authenticator)
    return found is not None and found.authentic


class EpisodesDone(NamedTuple):
    """What came of a search's episodes on a worker, piece by piece, and the seconds that it took."""

    rows: list[list[EpisodeResult]]
    wall_s: float


def search_workers() -> SearchWorkers | None:
    """Returns what has a search's episodes driven on workers, if SIMYARD_WORKERS names some; else None.

    Raises:
        DocumentError: It names none that there are.
    """
    workers = wanted_workers()

    def on_them(batch: OpenBatch, run: str, search: Callable[[DriveEpisodes], SearchResult]) -> SearchResult:
        assert workers  # noqa: S101 - it is returned only then
        ended: list[SearchResult] = []

        def steps(width: Width) -> None:
            with show_progress(STAGE, "search-progress"):
                ended.append(search(functools.partial(_driven_on_workers, batch, run, width)))

        on_workers(workers, "search", batch.id, steps)
        show_search(ended[0])
        return ended[0]

    return on_them if workers else None


def _driven_on_workers(
    batch: OpenBatch, run: str, width: Width, requests: Sequence[EpisodeRequest], engine: str
) -> list[EpisodeResult]:
    """Returns what came of a step's episodes, in their order.

    Raises:
        StageFailed: Somebody has cancelled the run, or a piece was lost several times.
    """
    pieces, rows = shared_out(batch, requests, width()), dict[int, list[EpisodeResult]]()

    def hand_out(numbers: Numbers) -> PrefectFuture[Any]:
        return simulate_episodes.with_options(task_run_name=_piece("episodes", numbers)).submit(
            batch.store.url,
            batch.id,
            [pieces[number] for number in numbers],
            engine=engine,
            authenticator=batch.authenticator,
        )

    def missing(numbers: Numbers) -> Numbers:
        return tuple(number for number in numbers if number not in rows)

    def on_end(end: PieceOutcome) -> float:
        done: EpisodesDone = end.result
        rows.update(zip(end.numbers, done.rows, strict=True))
        return done.wall_s

    def going() -> bool:
        return not is_canceled(batch.store, run)

    spread(range(len(pieces)), hand_out, width=width, going=going, missing=missing, on_end=on_end)
    if missing(tuple(range(len(pieces)))):
        raise StageFailed("Canceled", "its run was canceled on request", run)
    return [row for number in range(len(pieces)) for row in rows[number]]


@task(name="simulate-episodes", **TASK_OPTIONS)
def simulate_episodes(
    store_url: str,
    batch: str,
    pieces: list[tuple[EpisodeRequest, ...]],
    *,
    engine: str,
    authenticator: BatchAuthenticator,
) -> EpisodesDone:
    """Returns what came of some pieces of a search's episodes; runs on a worker, which may be another machine.

    Args:
        store_url: Where the batch's record, worlds and bundles are.
        batch: The batch's id.
        pieces: The episodes; all run the same applications.
        engine: What drives them.
        authenticator: The batch's.
    """
    start_s, opened = time.monotonic(), load_batch(open_store(store_url), batch, authenticator)
    folders = unpacked(opened.store, sorted(pieces[0][0].bundles))
    rows = [drive_episodes(opened, piece, engine, folders) for piece in pieces]
    return EpisodesDone(rows, time.monotonic() - start_s)
