"""Worlds made one after the other, by this process or by several, and handed over in order.

The processes are loky's rather than `multiprocessing`'s: those of the standard library run the caller's main script
again, or are forks of a process with threads, and a flow is called from any script.
"""

import gc
import os
import time
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from threading import Thread

from loky import ProcessPoolExecutor

from specs.base import Spec
from specs.errors import SimyardError
from specs.robomaker.failure_codes import WorldGenerationJobErrorCode
from specs.template.body import TemplateBody
from tasks.storage.worlds import encode_world
from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.generate import generate_world

# A worker takes about a second to start, in which one process makes about as many worlds.
_WORLDS_A_WORKER = 100
# Neighbours share their floor plan, which a worker keeps; few enough that progress is seen and memory stays flat.
_CHUNK = 10
_AHEAD = 3
# A world is some ten thousand objects, none of which refers to itself: hardly anything is garbage to look for.
_OBJECTS_A_SEARCH = 50_000
_LOOK_EVERY_S = 1.0

Indices = tuple[int, int]


class Order(Spec):
    """What all worlds of a job have in common."""

    template: TemplateBody
    seed: int
    generation: str
    robot_radius_m: float


class WorldOutcome(Spec):
    """What came of one world: its document, or why there is none.

    Attributes:
        document: Canonical JSON; empty for a world that was rejected.
    """

    indices: Indices
    document: str = ""
    code: WorldGenerationJobErrorCode | None = None
    reason: str = ""


class WorkerDied(SimyardError):  # noqa: N818 - a state, like StageFailed
    """A worker process ended before its work was done; the job can be run again and goes on where it was."""


def make(order: Order, indices: Indices) -> WorldOutcome:
    """Returns one world of an order, or why it cannot be."""
    try:
        world = generate_world(
            order.template,
            seed=order.seed,
            generation=order.generation,
            floorplan_index=indices[0],
            interior_index=indices[1],
            robot_radius_m=order.robot_radius_m,
        )
    except WorldRejected as rejected:
        return WorldOutcome(indices=indices, code=rejected.code, reason=rejected.reason)
    return WorldOutcome(indices=indices, document=encode_world(world).decode())


def produce(
    order: Order, indices: Sequence[Indices], workers: int | None = None
) -> Generator[WorldOutcome, None, None]:
    """Yields what came of each world, in the order of the indices, whatever the number of workers.

    Args:
        order: What the worlds have in common.
        indices: Floor plan and interior of each world.
        workers: Processes; None takes as many as there are cores, when there is enough to do for each.

    Raises:
        WorkerDied: A worker was killed.
    """
    if workers is None:
        workers = min(len(os.sched_getaffinity(0)), len(indices) // _WORLDS_A_WORKER)
    if workers < 2:
        for each in indices:
            yield make(order, each)
        return
    chunks = [list(indices[n : n + _CHUNK]) for n in range(0, len(indices), _CHUNK)]
    with _worker_pool(workers) as pool:
        running: deque[Future[list[WorldOutcome]]] = deque()
        for chunk in chunks:
            running.append(pool.submit(_make_chunk, order, chunk))
            if len(running) >= workers * _AHEAD:
                yield from running.popleft().result()
        while running:
            yield from running.popleft().result()


@contextmanager
def _worker_pool(workers: int) -> Generator[Executor, None, None]:
    """Yields processes that make worlds, and ends them, whatever they are doing.

    Raises:
        WorkerDied: One was killed.
    """
    one_thread = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}  # the workers take the cores
    pool = ProcessPoolExecutor(workers, initializer=_begin_worker, initargs=(os.getpid(),), env=one_thread)
    try:
        yield pool
    except BrokenProcessPool as exc:
        said = " ".join(str(exc).split())
        raise WorkerDied(f"a process that makes worlds ended; run again to go on. {said}") from exc
    finally:
        pool.shutdown(kill_workers=True)


def _begin_worker(job: int) -> None:
    """Readies a worker: Ctrl-C ends the job, and the job its workers, even where it is killed itself."""
    os.setsid()
    Thread(target=_end_after, args=(job,), daemon=True).start()
    # What is imported by now stays: looking through it for garbage again and again takes a twelfth of the time.
    gc.freeze()
    gc.set_threshold(_OBJECTS_A_SEARCH)


def _end_after(job: int) -> None:
    while os.getppid() == job:
        time.sleep(_LOOK_EVERY_S)
    os._exit(1)


def _make_chunk(order: Order, chunk: Sequence[Indices]) -> list[WorldOutcome]:
    return [make(order, each) for each in chunk]
