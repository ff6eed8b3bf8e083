"""The times of batches on this machine, and what they say of the next one.

Whole batches are remembered in the user's cache folder: a batch of the same programs takes the same again, but for what
its first run had to compile. Nothing of it is ever part of a result. A folder that cannot be written to, or a file of
another version, is as good as no memory at all.

A simple model of each engine, measured once, says how costs grow with lanes and steps; what chunks took before says how
fast this machine is and what the applications cost, which no model knows. Without such memory a short probe compares
this machine with the one of the measurements, and the range is wide.
"""

import hashlib
import logging
import math
import os
import time
from collections.abc import Sequence
from math import log
from pathlib import Path
from statistics import median

from pydantic import Field, TypeAdapter, ValidationError

from specs.base import Spec
from specs.data.episode import CONTROL_HZ
from specs.field_types import EngineName
from tasks.progress.log_lines import taken_s
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.metrics import recorded_metrics, work_of
from tasks.simulate.chunk.byproducts import ChunkTiming
from tasks.simulate.devices import device_count, device_kind
from tasks.simulate.engines.engine_table import ENGINES, EngineCost
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.chunks import SLICE_STEPS, program_key
from tasks.simulate.plan.episode_layout import Layout
from tasks.storage.base.local_files import cache_folder, whole_file
from tasks.storage.jobs.records import JobRecord

_PROBE_S = 0.00087
_MEASURED_DEVICES = 2


class Span(Spec):
    """From this to that."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        """Returns what is as many times the least as the most is times it."""
        return math.sqrt(max(self.low, 0.0) * self.high)

    def plus(self, other: "Span") -> "Span":
        """Returns the sum of what both may be."""
        return Span(low=self.low + other.low, high=self.high + other.high)

    def times(self, factor: float) -> "Span":
        """Returns so many of it."""
        return Span(low=factor * self.low, high=factor * self.high)


class Speed(Spec):
    """How much longer this machine takes than the model says.

    Attributes:
        drive: For control steps.
        ready: To make episodes ready.
        first: Seconds to compile or load a program; None if that is not known.
        share: Which part of their longest duration chunks take until their last episode ends.
        peak_bytes: The most memory that was seen for each lane count; empty if nothing is known.
    """

    drive: Span
    ready: Span
    share: Span
    first: Span | None = None
    peak_bytes: dict[int, int] = Field(default_factory=dict[int, int])


def remembered_speed(timings: Sequence[ChunkTiming], lanes: int, *, same_program: bool) -> Speed | None:
    """Returns what timings of an engine say; None if there are none of driving.

    Args:
        timings: Of one engine and kind of device.
        lanes: Of the chunks that are asked about: chunks of very different sizes are left out if there are others.
        same_program: Whether they are of the very applications that are asked about.
    """
    driven = [each for each in timings if each.slices > 0]
    known = [each for each in driven if lanes <= 2 * each.lanes <= 4 * lanes] or driven
    if not known:
        return None
    drive = [each.slices_s / (each.slices * _slice_s(ENGINES[each.engine].cost, each.lanes)) for each in known]
    ready = [each.ready_s / (each.episodes * ENGINES[each.engine].cost.ready_s) for each in known]
    shares = [each.slices / max(1, each.most_slices) for each in known]
    return Speed(
        drive=_spread(drive, 1.25 if same_program else 2.0),
        ready=_spread(ready, 1.25 if same_program else 2.0),
        share=Span(low=min(shares), high=max(shares)) if same_program else Span(low=0.5, high=1.0),
        first=_first(known) if same_program else None,
        peak_bytes={each.lanes: each.peak_bytes for each in known} if same_program else {},
    )


def probed_speed(devices: int) -> Speed:
    """Returns a guess from a hundredth of a second of arithmetic; the applications may be anything."""
    slower = _probe_s() / _PROBE_S * _MEASURED_DEVICES / max(1, devices)
    return Speed(
        drive=Span(low=0.5 * slower, high=2.0 * slower),
        ready=Span(low=0.5 * slower, high=2.0 * slower),
        share=Span(low=0.5, high=1.0),
    )


def driving_s(engine: EngineName, speed: Speed, *, episodes: int, lanes: int, chunks: int, duration_s: float) -> Span:
    """Returns the wall seconds of a program's chunks, compiling apart.

    Args:
        engine: What drives.
        speed: This machine's.
        episodes: In all.
        lanes: Of a chunk.
        chunks: How many there are.
        duration_s: The longest simulated time of an episode.
    """
    cost = ENGINES[engine].cost
    slices = -(-max(1, round(duration_s * CONTROL_HZ)) // SLICE_STEPS)
    each_s = slices * _slice_s(cost, lanes)
    drive = Span(low=speed.drive.low * speed.share.low, high=speed.drive.high * speed.share.high).times(each_s * chunks)
    return drive.plus(speed.ready.times(cost.ready_s * episodes))


def compiling_s(engine: EngineName, speed: Speed) -> Span:
    """Returns the wall seconds until a program's first step; one that never ran here is not in the cache."""
    if speed.first is not None:
        return speed.first
    cost = ENGINES[engine].cost
    ready = max(0.5, min(2.0, median([speed.ready.low, speed.ready.high])))
    return Span(low=0.6 * cost.compile_s * ready, high=1.6 * cost.compile_s * ready)


def memory_bytes(engine: EngineName, speed: Speed, lanes: int) -> Span:
    """Returns the most memory that a process takes which drives so many lanes at a time."""
    cost = ENGINES[engine].cost
    if speed.peak_bytes:
        nearest = min(speed.peak_bytes, key=lambda known: abs(known - lanes))
        seen = speed.peak_bytes[nearest] + (lanes - nearest) * cost.lane_bytes
        return Span(low=0.7 * seen, high=1.3 * seen)
    grown = cost.base_bytes + lanes * cost.lane_bytes
    return Span(low=0.6 * grown, high=cost.base_bytes * 1.3 + 3.0 * lanes * cost.lane_bytes)


def _first(timings: Sequence[ChunkTiming]) -> Span:
    """Returns what a program may take to compile or load: within a process, only the first chunk has to."""
    most_s = max(each.compile_s for each in timings)
    return Span(low=min(0.5 * most_s, ENGINES[timings[0].engine].cost.load_s), high=1.25 * most_s)


def _slice_s(cost: EngineCost, lanes: int) -> float:
    return SLICE_STEPS * (cost.step_s + lanes * cost.lane_step_s)


def _spread(ratios: Sequence[float], margin: float) -> Span:
    return Span(low=min(ratios) / margin, high=max(ratios) * margin)


def _probe_s() -> float:
    """Returns the seconds of some arithmetic like that of a step: small arrays, many operations; the best of three."""
    import numpy as np  # noqa: PLC0415 - where this machine is known, planning does without

    values = np.linspace(0.0, 1.0, 4096, dtype=np.float32)

    def once() -> float:
        start_s = time.perf_counter()
        for _ in range(200):
            np.sqrt(values * values + 1.0).sum()
        return time.perf_counter() - start_s

    return min(once() for _ in range(3))


logger = logging.getLogger(__name__)
_KEPT = 8
_MARGIN = 1.15
# From the command to the worlds, where nobody knows: imports, and the server's start (docs/reference/speed.md).
_START_S = 5.0
# A process that has lived longer without making worlds was there before its run, as a notebook's is, or one that waited
# for its turn.
_OLDEST_START_S = 60.0


class BatchTiming(Spec):
    """What a batch took that came to its end in one process.

    Attributes:
        episodes: How many it had.
        worlds: How many they took place in.
        before_s: From the process's start to the first chunk; None in a process that had run another batch. Of a
            process that was there before its run, such as a notebook's, it says nothing.
        worlds_s: Of that, to make the worlds.
        once_s: Of that, what no other run pays.
        chunks_s: Of all chunks.
        compile_s: Of that, to compile programs, or to load what was compiled.
        after_s: For tables, audit and report.
        audit_compile_s: Of that, likewise.
    """

    episodes: int
    worlds: int
    before_s: float | None
    worlds_s: float
    once_s: float
    chunks_s: float
    compile_s: float
    after_s: float
    audit_compile_s: float


_TIMINGS = TypeAdapter(list[BatchTiming])


def remember_batch(plan: BatchPlan, timing: BatchTiming) -> None:
    """Adds a timing to the last ones of a batch's programs, for as long as the cache folder is kept."""
    path = _batches_file(plan)
    try:
        with whole_file(path) as file:
            file.write(_TIMINGS.dump_json([*_read_batches(path), timing][-_KEPT:]))
    except OSError as exc:
        logger.debug("what the batch took is not remembered: %s", exc)


def recall_batches(plan: BatchPlan) -> list[BatchTiming]:
    """Returns what batches of the same programs, lanes, durations and audit took here on as many cores, by age."""
    return _read_batches(_batches_file(plan))


def worlds_of(plan: BatchPlan) -> int:
    """Returns how many worlds a batch's episodes take place in."""
    return len({world for template in plan.templates for world in plan.worlds_of(template)})


def remembered_wall_s(known: Sequence[BatchTiming], plan: BatchPlan, episodes: int, load_s: float) -> Span | None:
    """Returns what a batch takes, from the command to its end; None if none of its programs came to an end here.

    Args:
        known: What batches of its programs took.
        plan: The batch.
        episodes: How many it has.
        load_s: To load all its programs, if they were compiled in the only run that is known.
    """
    if not known:
        return None
    like = min(reversed(known), key=lambda each: abs(log(each.episodes / episodes)))
    # Lanes fall idle at a batch's end: the last episodes take as long as if there were as many as lanes.
    growth = (episodes + plan.lanes) / (like.episodes + plan.lanes)
    driven_s = (like.chunks_s - like.compile_s) * growth
    first_s, audit_first_s = (
        min(*taken, load_s) for taken in ([each.compile_s for each in known], [each.audit_compile_s for each in known])
    )
    # A batch that goes on, or has given worlds, makes none.
    made = next((each for each in reversed(known) if each.worlds_s > 0.0), like)
    making_s = made.worlds_s * worlds_of(plan) / made.worlds
    rest_s = _start_s(like) + making_s + like.after_s - like.audit_compile_s + audit_first_s
    total_s, margin = rest_s + first_s + driven_s, _MARGIN * max(growth, 1.0 / growth) ** 0.25
    return Span(low=total_s / margin, high=total_s * margin)


def _start_s(timing: BatchTiming) -> float:
    """Returns from the command to the first chunk, without worlds and without what is paid once."""
    if timing.before_s is None:
        return _START_S
    start_s = max(0.0, timing.before_s - timing.worlds_s - timing.once_s)
    return start_s if start_s <= _OLDEST_START_S else _START_S


def process_age_s() -> float | None:
    """Returns how long this process has lived; None where the kernel does not say."""
    try:
        began = float(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19]) / os.sysconf("SC_CLK_TCK")
        return time.clock_gettime(time.CLOCK_BOOTTIME) - began
    except (OSError, ValueError, IndexError, AttributeError):
        return None


def _read_batches(path: Path) -> list[BatchTiming]:
    try:
        return _TIMINGS.validate_json(path.read_bytes())
    except (OSError, ValidationError):
        return []


def _batches_file(plan: BatchPlan) -> Path:
    programs = sorted(repr(program_key(request)) for request, _ in Layout(plan).programs())
    longest_s = max((template.duration_s for template in plan.templates), default=0.0)
    machine = device_kind(), device_count()  # of one machine: cores may be fewer for this process
    known_by = (programs, plan.engine, plan.lanes, plan.audit, longest_s, plan.records(), machine)
    return cache_folder() / "batches" / f"{hashlib.sha256(repr(known_by).encode()).hexdigest()}.json"


# Steps before the first chunk that a run pays again for its worlds, and those that only a first run pays: Prefect's
# database is there the next time, and so are the files of applications.
_OF_WORLDS = ("generate_worlds", "draw_worlds")
_ONCE = ("make_server_database", "unpack_application")


class _Process:
    batches, worlds_s = 0, 0.0


class BatchWatch:
    """Takes the times of a batch."""

    def __init__(self) -> None:
        """Begins before the first chunk."""
        self._before_s = None if _Process.batches else process_age_s()
        worlds_s, self._once_s = taken_s(*_OF_WORLDS), taken_s(*_ONCE)
        self._worlds_s = worlds_s - _Process.worlds_s  # since the batch before
        _Process.batches, _Process.worlds_s = _Process.batches + 1, worlds_s
        self._began_s = self._driven_s = time.monotonic()

    def drove(self) -> None:
        """Notes that all chunks are committed."""
        self._driven_s = time.monotonic()

    def keep(self, batch: OpenBatch, record: JobRecord, audited: Sequence[ChunkTiming]) -> None:
        """Remembers what a batch took, if this process simulated all of it.

        Args:
            batch: The batch.
            record: Its record at its end.
            audited: What its audit's chunks took.
        """
        metrics = recorded_metrics(record)
        whole = metrics is not None and metrics.chunks == batch.layout.chunks and metrics.workers == 1
        if metrics is None or not whole or record.status != "Completed":
            return
        chunks_s, after_s = self._driven_s - self._began_s, time.monotonic() - self._driven_s
        remember_batch(
            batch.plan,
            BatchTiming(
                episodes=batch.layout.episodes,
                worlds=worlds_of(batch.plan),
                before_s=self._before_s,
                worlds_s=self._worlds_s,
                once_s=self._once_s,
                chunks_s=chunks_s,
                compile_s=min(metrics.compile_s, chunks_s),
                after_s=after_s,
                audit_compile_s=min(
                    work_of(audited, simulated_s=0.0, wall_s=0.0).compile_s, after_s - _rest_s(audited, after_s)
                ),
            ),
        )


def _rest_s(audited: Sequence[ChunkTiming], most_s: float) -> float:
    """Returns what an audit takes at least when its programs are there: its parts drive while others compile.

    Args:
        audited: What its chunks took.
        most_s: What it took.
    """
    return min(most_s, max((each.ready_s + each.slices_s for each in audited), default=0.0))
