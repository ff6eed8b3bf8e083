"""The times of batches on this machine, and what they say of the next one.

Whole batches are remembered in the user's cache folder: a batch of the same programs takes the same again, but for what
its first run had to compile. Nothing of it is ever part of a result. A folder that cannot be written to, or a file of
another version, is as good as no memory at all.
"""

import hashlib
import logging
import math
import os
import time
from collections.abc import Sequence
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from specs.base import Spec
from tasks.progress.log_lines import taken_s
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.metrics import recorded_metrics, work_of
from tasks.simulate.chunk.byproducts import ChunkTiming
from tasks.simulate.devices import device_count, device_kind
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.chunks import program_key
from tasks.simulate.plan.episode_layout import Layout
from tasks.storage.base.local_files import cache_folder, whole_file
from tasks.storage.jobs.records import JobRecord

logger = logging.getLogger(__name__)
_KEPT = 8
# Of as many batches whose programs, lanes or durations differ; those that were remembered last.
_FILES_KEPT = 200
_MARGIN = 1.15
_LESS_MEMORY, _MORE_MEMORY = 0.7, 1.3
# From the command to the worlds, where nobody knows: imports, and the server's start (docs/reference/speed.md).
_START_S = 5.0
# A process that has lived longer without making worlds was there before its run, as a notebook's is, or one that waited
# for its turn.
_OLDEST_START_S = 60.0
# Steps before the first chunk that a run pays again for its worlds, and those that only a first run pays: Prefect's
# database is there the next time, and so are the files of applications.
_OF_WORLDS = ("generate_worlds", "draw_worlds")
_ONCE = ("make_server_database", "unpack_application")


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
        peak_bytes: The most memory that a process held which simulated or audited it; 0 if that is not known.
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
    peak_bytes: int = 0


_TIMINGS = TypeAdapter(list[BatchTiming])


def remember_batch(plan: BatchPlan, timing: BatchTiming) -> None:
    """Adds a timing to the last ones of a batch's programs, for as long as the cache folder is kept."""
    path = _batches_file(plan)
    try:
        with whole_file(path) as file:
            file.write(_TIMINGS.dump_json([*_read_batches(path), timing][-_KEPT:]))
        _forget_oldest(path.parent)
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
    like = min(reversed(known), key=lambda each: abs(math.log(each.episodes / episodes)))
    # Lanes fall idle at a batch's end: the last episodes take as long as if there were as many as lanes.
    growth = (episodes + plan.lanes) / (like.episodes + plan.lanes)
    driven_s = (like.chunks_s - like.compile_s) * growth
    first_s, audit_first_s = _first_s(known, load_s)
    # A batch that goes on, or has given worlds, makes none.
    made = next((each for each in reversed(known) if each.worlds_s > 0.0), like)
    making_s = made.worlds_s * worlds_of(plan) / made.worlds
    rest_s = _start_s(like) + making_s + like.after_s - like.audit_compile_s + audit_first_s
    total_s, margin = rest_s + first_s + driven_s, _MARGIN * max(growth, 1.0 / growth) ** 0.25
    return Span(low=total_s / margin, high=total_s * margin)


def compiling_s(known: Sequence[BatchTiming], load_s: float) -> float:
    """Returns how much longer a batch took at most that had to compile than `remembered_wall_s` says of one that loads.

    Args:
        known: What batches of its programs took.
        load_s: To load all its programs.
    """
    if not known:
        return 0.0
    return max(each.compile_s + each.audit_compile_s for each in known) - sum(_first_s(known, load_s))


def _first_s(known: Sequence[BatchTiming], load_s: float) -> tuple[float, float]:
    """Returns what programs that are there take to load: those of the batch, and those of its audit."""
    return min(load_s, *(each.compile_s for each in known)), min(load_s, *(each.audit_compile_s for each in known))


def remembered_bytes(known: Sequence[BatchTiming]) -> Span | None:
    """Returns the most memory that a batch takes, as the last one of its programs and lanes that said so."""
    peak_bytes = next((each.peak_bytes for each in reversed(known) if each.peak_bytes), 0)
    return Span(low=_LESS_MEMORY * peak_bytes, high=_MORE_MEMORY * peak_bytes) if peak_bytes else None


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


def _forget_oldest(folder: Path) -> None:
    """Removes the files that were written longest ago, where there are more than are kept."""
    files = sorted(folder.glob("*.json"), key=lambda path: path.stat().st_mtime_ns, reverse=True)
    for path in files[_FILES_KEPT:]:
        path.unlink(missing_ok=True)


def _batches_file(plan: BatchPlan) -> Path:
    programs = sorted(repr(program_key(request)) for request, _ in Layout(plan).programs())
    longest_s = max((template.duration_s for template in plan.templates), default=0.0)
    machine = device_kind(), device_count()  # of one machine: cores may be fewer for this process
    met = [name for name in ("people", "boxes", "robots") if getattr(plan, name)]  # other programs, which take longer
    known_by = (programs, plan.engine, plan.lanes, plan.audit, longest_s, plan.records(), machine, met)
    return cache_folder() / "timings" / f"{hashlib.sha256(repr(known_by).encode()).hexdigest()}.json"


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

    def keep(
        self, batch: OpenBatch, record: JobRecord, driven: Sequence[ChunkTiming], audited: Sequence[ChunkTiming]
    ) -> None:
        """Remembers what a batch took, if this process simulated all of it.

        Args:
            batch: The batch.
            record: Its record at its end.
            driven: What its chunks took.
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
                peak_bytes=max((each.peak_bytes for each in (*driven, *audited)), default=0),
            ),
        )


def _rest_s(audited: Sequence[ChunkTiming], most_s: float) -> float:
    """Returns what an audit takes at least when its programs are there: its parts drive while others compile.

    Args:
        audited: What its chunks took.
        most_s: What it took.
    """
    return min(most_s, max((each.ready_s + each.slices_s for each in audited), default=0.0))
