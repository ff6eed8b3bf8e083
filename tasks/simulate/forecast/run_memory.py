"""What whole batches took on this machine, kept in the user's cache folder for `simyard plan` to predict with.

A batch of the same programs takes the same again, but for what its first run had to compile. Nothing of it is ever part
of a result. A folder that cannot be written to, or a file of another version, is as good as no memory at all.
"""

import hashlib
import logging
import os
import time
from collections.abc import Sequence
from math import log
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from specs.base import Spec
from tasks.simulate.devices import device_count, device_kind
from tasks.simulate.forecast.cost import Span
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.chunks import program_key
from tasks.simulate.plan.layout import Layout
from tasks.storage.base.atomic_file import whole_file
from tasks.storage.base.cache_folder import cache_folder

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
    path = _path(plan)
    try:
        with whole_file(path) as file:
            file.write(_TIMINGS.dump_json([*_read(path), timing][-_KEPT:]))
    except OSError as exc:
        logger.debug("what the batch took is not remembered: %s", exc)


def recall_batches(plan: BatchPlan) -> list[BatchTiming]:
    """Returns what batches of the same programs, lanes, durations and audit took here on as many cores, by age."""
    return _read(_path(plan))


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


def _read(path: Path) -> list[BatchTiming]:
    try:
        return _TIMINGS.validate_json(path.read_bytes())
    except (OSError, ValidationError):
        return []


def _path(plan: BatchPlan) -> Path:
    programs = sorted(repr(program_key(request)) for request, _ in Layout(plan).programs())
    longest_s = max((template.duration_s for template in plan.templates), default=0.0)
    machine = device_kind(), device_count()  # of one machine: cores may be fewer for this process
    known_by = (programs, plan.engine, plan.lanes, plan.audit, longest_s, plan.records(), machine)
    return cache_folder() / "batches" / f"{hashlib.sha256(repr(known_by).encode()).hexdigest()}.json"
