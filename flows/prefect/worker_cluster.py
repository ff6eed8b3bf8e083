"""Workers of a cluster: Dask and Ray behind Prefect's task runners, and pieces of work spread over them.

Both are extras, and imported only when they are used. The store says which pieces are done, not the future of a task: a
worker that dies after it has committed has done its work.
"""
# ruff: noqa: PLC0415 - see above

import asyncio
import logging
import math
import os
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from functools import partial
from importlib.util import find_spec
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple

from prefect import flow
from prefect.context import FlowRunContext
from prefect.futures import PrefectFuture
from prefect.task_runners import TaskRunner

from specs.errors import DocumentError, StageFailed
from specs.settings import WORKERS, Workers, chosen_workers

_ASK_EVERY_S = 1.0
_DEVICES_FLAG = "--xla_force_host_platform_device_count"


Width = Callable[[], int]
# Not in the flow's closure: Prefect sends the flow along with each task, and work holds claims and connections.
_work_of_flow: ContextVar[Callable[[Width], None]] = ContextVar("_given")


class WorkerCluster(NamedTuple):
    """A task runner, and a function that returns how many tasks its started copy can run at a time."""

    runner: TaskRunner[Any]
    width: Callable[[Any], int]


def wanted_workers() -> Workers | None:
    """Returns what SIMYARD_WORKERS asks for; None where this process does the work.

    Raises:
        DocumentError: It asks for nothing that there is, or that is not installed.
    """
    workers = chosen_workers()
    if workers and find_spec(f"prefect_{workers.kind}") is None:
        allowed = f"a kind of workers that is installed: simyard[{workers.kind}]"
        raise DocumentError.of(WORKERS, workers.kind, allowed)
    return workers


def on_workers(workers: Workers, name: str, run: str, work: Callable[[Width], None]) -> None:
    """Does work in a flow of its own, since a task runner belongs to a flow, and this one depends on a setting.

    Args:
        workers: Those that tasks which the work submits go to.
        name: The flow's.
        run: What Prefect's pages call this run of it.
        work: Told how to find out how many workers there are now.
    """
    crew = cluster_of(workers)

    @flow(name=name, flow_run_name=run, task_runner=crew.runner, persist_result=False)
    def pieces() -> None:
        context = FlowRunContext.get()
        started = context.task_runner if context else crew.runner  # a flow starts a copy of the runner that it is given
        _work(_once_a_second(partial(crew.width, started)))

    token = _work_of_flow.set(work)
    try:
        pieces()
    finally:
        _work_of_flow.reset(token)


def _work(width: Width) -> None:
    _work_of_flow.get()(width)


def _once_a_second(width: Width) -> Width:
    """Returns a function that asks at most once a second: a scheduler lists all of its workers each time."""
    counted, asked_s = 0, -math.inf

    def count() -> int:
        nonlocal counted, asked_s
        if time.monotonic() - asked_s >= _ASK_EVERY_S:
            counted, asked_s = width(), time.monotonic()
        return counted

    return count


def cluster_of(workers: Workers) -> WorkerCluster:
    """Returns the crew of workers that are wanted."""
    return _dask(workers) if workers.kind == "dask" else _ray(workers)


def _dask(workers: Workers) -> WorkerCluster:
    from prefect_dask.task_runners import DaskTaskRunner

    if workers.address:
        runner = DaskTaskRunner(address=workers.address)
    else:
        count = workers.count or _cores()
        runner = DaskTaskRunner(
            cluster_kwargs={
                "n_workers": count,
                "threads_per_worker": 1,  # JAX has threads of its own
                "processes": True,
                "host": "127.0.0.1",
                "dashboard_address": None,
                "memory_limit": 0,  # lanes are fitted to what memory there is (tasks.simulate.sandbox.sandbox_client)
                "env": _share(count),
            }
        )

    def width(started: DaskTaskRunner) -> int:
        return max(1, len(started.client.scheduler_info(n_workers=-1)["workers"]))

    return WorkerCluster(runner, width)


def _ray(workers: Workers) -> WorkerCluster:
    import ray  # pyright: ignore[reportMissingImports] - an extra
    from prefect_ray.task_runners import RayTaskRunner  # pyright: ignore[reportMissingImports]

    if workers.address:
        runner = RayTaskRunner(address=workers.address)
    else:
        count = workers.count or _cores()
        runner = RayTaskRunner(
            init_kwargs={
                "num_cpus": count,
                "include_dashboard": False,
                "_node_ip_address": "127.0.0.1",
                "log_to_driver": False,
                "runtime_env": {"env_vars": _share(count)},
            }
        )
    return WorkerCluster(runner, lambda _started: max(1, int(ray.cluster_resources().get("CPU", 1))))


def _share(count: int) -> dict[str, str]:
    """Returns the variables that make each of several workers on this machine use its share of the cores."""
    flags = os.environ.get("XLA_FLAGS", "")
    if _DEVICES_FLAG in flags:
        return {}
    return {"XLA_FLAGS": f"{flags} {_DEVICES_FLAG}={max(1, _cores() // count)}".strip()}


def _cores() -> int:
    return len(os.sched_getaffinity(0))


_LOG = logging.getLogger(__name__)
# A worker that ends a task finds the next one there; more than that is not handed out ahead.
_AHEAD = 2
_ATTEMPTS = 4
# Long beside what handing out a piece costs its worker. Who works on one looks at the record before each chunk, so that
# a cancellation does not wait for its end, and has committed what was done of it when it dies.
_AIM_S = 15.0
# Handing out a piece costs this process, and Prefect's server, about a tenth of a second each
# (docs/operate/scale.md): many workers get longer ones, so that both keep up with any number of them.
_AIM_S_A_WORKER = 0.2
_LOOK_S = 0.5
# Workers that live end a piece that nobody wants within seconds; a cluster may have lost them all.
_PATIENCE_S = 20.0

Numbers = tuple[int, ...]


class PieceOutcome(NamedTuple):
    """A piece that was handed out, and what became of it.

    Attributes:
        result: What its task returned; None if it did not come to that.
        failure: Why it did not.
    """

    numbers: Numbers
    result: Any
    failure: str


class PieceSize:
    """How many numbers go into a piece, by how long the last ones took."""

    def __init__(self) -> None:
        self._each_s: float | None = None

    def learn(self, numbers: int, wall_s: float) -> None:
        """Learns how long a worker took for a piece."""
        each_s = wall_s / max(numbers, 1)
        self._each_s = each_s if self._each_s is None else 0.5 * (self._each_s + each_s)

    def size(self, left: int, width: int) -> int:
        """Returns how many of what is left go into the next piece; so few of the last ones that all workers share."""
        if self._each_s is None:
            return 1
        aim_s = max(_AIM_S, width * _AIM_S_A_WORKER)
        return max(1, min(int(aim_s / max(self._each_s, 1e-3)), left // (width * _AHEAD)))


def spread(
    numbers: Sequence[int],
    hand_out: Callable[[Numbers], PrefectFuture[Any]],
    *,
    width: Callable[[], int],
    going: Callable[[], bool],
    missing: Callable[[Numbers], Numbers],
    on_end: Callable[[PieceOutcome], float],
) -> None:
    """Hands numbers out in order until all are done, or none is wanted any more.

    It waits for the workers; once nothing is wanted, for 20 seconds at most.

    Args:
        numbers: What there is to do.
        hand_out: Gives a piece to a worker.
        width: How many workers there are now.
        going: Whether anything more is wanted.
        missing: Which of some numbers are not done, whatever their workers said.
        on_end: Called with each piece that ended; returns how long its worker took, in seconds.

    Raises:
        StageFailed: A piece was lost four times.
    """
    pieces, unwanted = _Pieces(numbers, hand_out, width), _Unwanted(going)
    pace, lost = PieceSize(), Counter[int]()
    while pieces.left or pieces.flying:
        if unwanted():
            pieces.left.clear()
            if unwanted.for_long():
                _LOG.warning("%d pieces that nobody wants any more are not waited for", pieces.flying)
                return
        pieces.fill(pace)
        end = pieces.next_end()
        if end is None:
            continue
        if end.failure:
            pieces.left.extendleft(reversed(_to_repeat(end, missing(end.numbers), lost)))
        else:
            pace.learn(len(end.numbers), on_end(end))


class _Pieces:
    """Numbers that are not handed out yet, and the pieces that workers have.

    Attributes:
        left: Numbers that are not handed out.
        flying: How many pieces are handed out and have not ended.
    """

    def __init__(
        self, numbers: Sequence[int], hand_out: Callable[[Numbers], PrefectFuture[Any]], width: Callable[[], int]
    ) -> None:
        self.left, self.flying = deque(numbers), 0
        self._hand_out, self._width = hand_out, width
        self._ended: SimpleQueue[PieceOutcome] = SimpleQueue()

    def fill(self, pace: PieceSize) -> None:
        """Hands out so many pieces that each worker has the next one there."""
        while self.left and self.flying < self._width() * _AHEAD:
            piece = tuple(self.left.popleft() for _ in range(pace.size(len(self.left), self._width())))
            _await(piece, self._hand_out(piece), self._ended)
            self.flying += 1

    def next_end(self) -> PieceOutcome | None:
        """Returns a piece that ended; None if none did in half a second."""
        try:
            end = self._ended.get(timeout=_LOOK_S)
        except Empty:
            return None
        self.flying -= 1
        return end


class _Unwanted:
    """Whether nothing more is wanted, and since when."""

    def __init__(self, going: Callable[[], bool]) -> None:
        self._going = going
        self._since_s: float | None = None

    def __call__(self) -> bool:
        if self._going():
            return False
        self._since_s = time.monotonic() if self._since_s is None else self._since_s
        return True

    def for_long(self) -> bool:
        return self._since_s is not None and time.monotonic() - self._since_s >= _PATIENCE_S


def _to_repeat(end: PieceOutcome, missing: Numbers, lost: Counter[int]) -> Numbers:
    """Returns what of a piece has to be handed out again."""
    lost.update(missing)
    if any(lost[number] >= _ATTEMPTS for number in missing):
        why = f"{missing[0]} was lost {_ATTEMPTS} times, the last time because: {end.failure}"
        raise StageFailed("InternalServiceError", why)
    if missing:
        _LOG.warning("handing out %s again: %s", missing, end.failure)
    return missing


def _await(numbers: Numbers, future: PrefectFuture[Any], ended: "SimpleQueue[PieceOutcome]") -> None:
    """Puts a piece into the queue when it has ended; a future's own callbacks differ between Dask and Ray."""

    def wait() -> None:
        try:
            ended.put(PieceOutcome(numbers, future.result(), ""))
        # Whatever a worker died of is reported, and the store is asked; CancelledError is no Exception in Python.
        except (Exception, asyncio.CancelledError) as exc:  # noqa: BLE001 - see above
            ended.put(PieceOutcome(numbers, None, f"{type(exc).__name__}: {exc}"))

    threading.Thread(target=wait, name=f"piece {numbers[0]}", daemon=True).start()
