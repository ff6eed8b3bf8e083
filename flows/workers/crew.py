"""Dask and Ray behind Prefect's task runners; both are extras, and imported only when they are used."""
# ruff: noqa: PLC0415 - see above

import math
import os
import time
from collections.abc import Callable
from contextvars import ContextVar
from functools import partial
from importlib.util import find_spec
from typing import Any, NamedTuple

from prefect import flow
from prefect.context import FlowRunContext
from prefect.task_runners import TaskRunner

from specs.base import Fault
from specs.errors import DocumentError
from specs.settings import WORKERS, Workers, chosen_workers

_ASK_EVERY_S = 1.0
_DEVICES_FLAG = "--xla_force_host_platform_device_count"


Width = Callable[[], int]
# Not in the flow's closure: Prefect sends the flow along with each task, and work holds claims and connections.
_work_of_flow: ContextVar[Callable[[Width], None]] = ContextVar("_given")


class Crew(NamedTuple):
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
        raise DocumentError([Fault(path=WORKERS, value=workers.kind, allowed=allowed)])
    return workers


def on_workers(workers: Workers, name: str, run: str, work: Callable[[Width], None]) -> None:
    """Does work in a flow of its own, since a task runner belongs to a flow, and this one depends on a setting.

    Args:
        workers: Those that tasks which the work submits go to.
        name: The flow's.
        run: What Prefect's pages call this run of it.
        work: Told how to find out how many workers there are now.
    """
    crew = crew_of(workers)

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


def crew_of(workers: Workers) -> Crew:
    """Returns the crew of workers that are wanted."""
    return _dask(workers) if workers.kind == "dask" else _ray(workers)


def _dask(workers: Workers) -> Crew:
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
                "memory_limit": 0,  # lanes are fitted to what memory there is (tasks.simulate.chunk.memory_fit)
                "env": _share(count),
            }
        )

    def width(started: DaskTaskRunner) -> int:
        return max(1, len(started.client.scheduler_info(n_workers=-1)["workers"]))

    return Crew(runner, width)


def _ray(workers: Workers) -> Crew:
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
    return Crew(runner, lambda _started: max(1, int(ray.cluster_resources().get("CPU", 1))))


def _share(count: int) -> dict[str, str]:
    """Returns the variables that make each of several workers on this machine use its share of the cores."""
    flags = os.environ.get("XLA_FLAGS", "")
    if _DEVICES_FLAG in flags:
        return {}
    return {"XLA_FLAGS": f"{flags} {_DEVICES_FLAG}={max(1, _cores() // count)}".strip()}


def _cores() -> int:
    return len(os.sched_getaffinity(0))
