"""Spreads the making and the export of worlds over the workers of a Dask or Ray cluster, through the store."""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple

from prefect import task
from prefect.cache_policies import NO_CACHE
from prefect.futures import PrefectFuture

from flows.workers.crew import Width, on_workers, wanted_workers
from flows.workers.spread import Numbers, PieceOutcome, spread
from specs.job_kinds import JobKind
from specs.pipeline.world_sections import WorldFormat
from tasks.export.job import job as exporting
from tasks.export.job.world_files import kept_parts, make_parts
from tasks.progress.step_retry import STORE_RETRY
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import read
from tasks.storage.store_url import open_store
from tasks.worlds.job import job as generating
from tasks.worlds.job.production import Indices, Order, WorldOutcome
from tasks.worlds.job.world_store import make_and_keep, missing_worlds

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


@task(name="make-worlds", cache_policy=NO_CACHE, persist_result=False, **STORE_RETRY)
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


@task(name="write-worlds", cache_policy=NO_CACHE, persist_result=False, **STORE_RETRY)
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
