"""Worlds made one after the other, by this process or by several, and handed over in order.

Workers are processes of their own rather than `multiprocessing`'s: that one runs the caller's main script again, and
a flow is called from any script. A worker ends when its input does, so none outlives a killed job.
"""

import os
import subprocess
import sys
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from queue import SimpleQueue
from typing import IO, cast

from pydantic import TypeAdapter

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
_BUFFER = 1 << 16

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


_MADE = TypeAdapter(list[WorldOutcome])
INDICES = TypeAdapter(list[Indices])


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


def answer(made: Sequence[WorldOutcome]) -> bytes:
    """Returns what a worker says of a chunk: a line of all outcomes but for their documents, then a line of each.

    Within a text of JSON, a document would have to be written, and read, once more: a twentieth of the time that it
    takes to make it. Canonical JSON has no line breaks.
    """
    head = _MADE.dump_json(list(made), exclude={"__all__": {"document"}})
    return b"\n".join([head, *[outcome.document.encode() for outcome in made], b""])


def produce(
    order: Order, indices: Sequence[Indices], workers: int | None = None
) -> Generator[WorldOutcome, None, None]:
    """Yields what came of each world, in the order of the indices, whatever the number of workers.

    Args:
        order: What the worlds have in common.
        indices: Floor plan and interior of each world.
        workers: Processes; None takes as many as there are cores, when there is enough to do for each.

    Raises:
        WorkerDied: A worker was killed, or broke.
    """
    if workers is None:
        workers = min(len(os.sched_getaffinity(0)), len(indices) // _WORLDS_A_WORKER)
    if workers < 2:
        yield from (make(order, each) for each in indices)
        return
    chunks = [list(indices[n : n + _CHUNK]) for n in range(0, len(indices), _CHUNK)]
    with ThreadPoolExecutor(workers) as threads, _crew(order, workers) as idle:
        running: deque[Future[list[WorldOutcome]]] = deque()
        for chunk in chunks:
            running.append(threads.submit(_ask, idle, chunk))
            if len(running) >= workers * _AHEAD:
                yield from running.popleft().result()
        while running:
            yield from running.popleft().result()


class _Worker:
    """A worker process that knows its order."""

    def __init__(self, order: Order) -> None:
        # Its own session: Ctrl-C ends the job, and the job its workers. One thread each: workers take the cores.
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tasks.worlds.job.worker_process"],
            bufsize=_BUFFER,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
        self._questions = cast("IO[bytes]", self._process.stdin)
        self._answers = cast("IO[bytes]", self._process.stdout)
        self._tell(order.model_dump_json(exclude_unset=True).encode())

    def ask(self, chunk: list[Indices]) -> list[WorldOutcome]:
        """Returns what the worker makes of a chunk.

        Raises:
            WorkerDied: The process was killed, or broke.
        """
        self._tell(INDICES.dump_json(chunk))
        made = _MADE.validate_json(self._line())
        return [outcome.model_copy(update={"document": self._line().decode()}) for outcome in made]

    def _line(self) -> bytes:
        line = self._answers.readline()
        if not line.endswith(b"\n"):
            raise WorkerDied(f"a process that makes worlds ended with {self._process.wait()}; run again to go on")
        return line[:-1]

    def end(self) -> None:
        """Ends the process, whatever it is doing."""
        self._process.kill()
        self._process.communicate()

    def _tell(self, line: bytes) -> None:
        with suppress(BrokenPipeError):  # a dead worker gives no answer, which `ask` finds
            self._questions.write(line + b"\n")
            self._questions.flush()


def _ask(idle: "SimpleQueue[_Worker]", chunk: list[Indices]) -> list[WorldOutcome]:
    """Returns what an idle worker makes of a chunk; there are as many threads as workers."""
    worker = idle.get()
    try:
        return worker.ask(chunk)
    finally:
        idle.put(worker)


@contextmanager
def _crew(order: Order, workers: int) -> Generator["SimpleQueue[_Worker]", None, None]:
    """Yields that many workers which know the order, and ends them."""
    crew: list[_Worker] = []
    idle: SimpleQueue[_Worker] = SimpleQueue()
    try:
        for _ in range(workers):
            crew.append(_Worker(order))
            idle.put(crew[-1])
        yield idle
    finally:
        for worker in crew:
            worker.end()
