"""How many worlds a second come out, and which stage of the generator takes how long."""

import os
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from statistics import median
from typing import ParamSpec, TypeVar
from unittest.mock import patch

from benchmarks.worlds.world_templates import SPEED_TEMPLATES, read_template
from specs.data.world import ROBOT_RADIUS_M
from tasks.storage.worlds import encode_world
from tasks.worlds import generate
from tasks.worlds.job.production import Order, produce

INTERIORS = (1, 10)
"""Interiors of a floor plan: a new plan for each world, and ten worlds of each plan."""
WORKERS = (1, 2)
# Two workers hand worlds over in tens, so that only even numbers of tens are whole.
_BATCH = 20
_WARM = 2 * _BATCH
_MOST_WORLDS = 100_000
# What `generate_world` calls for each stage; what is left is walls, doors, materials and the document.
STAGES = {
    "plan": ("sound_plan",),
    "interior": ("furnish_interior",),
    "certificate": ("survey", "certify"),
}

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class Case:
    """What is measured: a template, how many interiors share a plan, and how many processes make worlds."""

    template: str
    interiors: int
    workers: int


@dataclass(frozen=True)
class Rate:
    """One measurement.

    Attributes:
        per_s: Worlds a second once all processes run and are warm, certificate and encoding included.
        start_s: What it took beyond that until they were: starting processes, importing, filling caches.
        cpu_ms: Processor time of this process for each world, which says the same on a busy machine.
    """

    per_s: float
    start_s: float
    cpu_ms: float


def measure_rates(repeats: int, seconds: float) -> dict[Case, list[Rate]]:
    """Returns measurements of all cases; repeats are interleaved, so that a busy moment hits all cases alike."""
    cases = [Case(name, each, workers) for name in SPEED_TEMPLATES for each in INTERIORS for workers in WORKERS]
    found: dict[Case, list[Rate]] = {case: [] for case in cases}
    for repeat in range(repeats):
        for case, rates in found.items():
            with _cores(case.workers):
                rates.append(measure_rate(case, seed=repeat, seconds=seconds))
    return found


def measure_rate(case: Case, seed: int, seconds: float) -> Rate:
    """Returns how fast the worlds of one seed come out, over at least so many seconds."""
    order = Order(
        template=read_template(case.template), seed=seed, generation="benchmark", robot_radius_m=ROBOT_RADIUS_M
    )
    indices = [(1 + world // case.interiors, 1 + world % case.interiors) for world in range(_MOST_WORLDS)]
    begin_s = time.perf_counter()
    with closing(produce(order, indices, case.workers)) as products:
        for _ in range(_WARM):
            next(products)
        warm_s, warm_cpu_s = time.perf_counter(), time.process_time()
        made, elapsed_s = 0, 0.0
        while elapsed_s < seconds:
            for _ in range(_BATCH):
                next(products)
            made, elapsed_s = made + _BATCH, time.perf_counter() - warm_s
        cpu_s = time.process_time() - warm_cpu_s
    return Rate(made / elapsed_s, max(warm_s - begin_s - _WARM * elapsed_s / made, 0.0), 1e3 * cpu_s / made)


@contextmanager
def _cores(count: int) -> Generator[None, None, None]:
    """Lets this process and its children use so many cores."""
    all_cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(all_cores)[:count])
    try:
        yield
    finally:
        os.sched_setaffinity(0, all_cores)


def measure_stages(template: str, interiors: int, worlds: int) -> dict[str, float]:
    """Returns the milliseconds of each stage for a world, and of all of them, in this process."""
    body = read_template(template)
    spent_s = dict.fromkeys([*STAGES, "encoding", "all"], 0.0)
    with ExitStack() as stack:
        for stage, names in STAGES.items():
            for name in names:
                timed = _timed(spent_s, stage, getattr(generate, name))
                stack.enter_context(patch.object(generate, name, timed))
        make, encode = _timed(spent_s, "all", generate.generate_world), _timed(spent_s, "encoding", encode_world)
        for world in range(-_BATCH, worlds):
            if world == 0:  # the ones before were to warm up
                spent_s.update(dict.fromkeys(spent_s, 0.0))
            plan, interior = 1_000 + world // interiors, 1 + world % interiors
            encode(make(body, seed=0, generation="benchmark", floorplan_index=plan, interior_index=interior))
    return _in_order({stage: 1e3 * seconds / worlds for stage, seconds in spent_s.items()})


def _in_order(spent_ms: dict[str, float]) -> dict[str, float]:
    """Returns the stages with what is none of them as `rest`, and with the encoding in `all`."""
    rest = spent_ms["all"] - sum(spent_ms[stage] for stage in STAGES)
    stages = {**{stage: spent_ms[stage] for stage in STAGES}, "rest": rest, "encoding": spent_ms["encoding"]}
    return {**stages, "all": sum(stages.values())}


def _timed(spent_s: dict[str, float], stage: str, work: Callable[P, R]) -> Callable[P, R]:
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        start_s = time.perf_counter()
        try:
            return work(*args, **kwargs)
        finally:
            spent_s[stage] += time.perf_counter() - start_s

    return run


def middle(rates: Sequence[Rate], figure: Callable[[Rate], float]) -> float:
    """Returns the median of one figure."""
    return median(figure(rate) for rate in rates)
