"""What comes of a chunk besides its rows: the times that it took, and the tags that applications gave to their jobs.

Both are on their way to whoever collects them. Whoever simulates without a wish for tags, such as an audit, loses
nothing by leaving them.
"""

import resource
import sys
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from threading import get_ident
from time import monotonic
from typing import Annotated, NamedTuple

from pydantic import Field

from specs.base import Spec
from tasks.simulate.devices import compiled_s

# Linux counts in kibibytes, macOS in bytes.
_PEAK_UNIT = 1 if sys.platform == "darwin" else 1024


# Nothing of it is ever part of a result.
class ChunkTiming(Spec):
    """What one chunk took that came to its end.

    Attributes:
        lanes: Of the program, idle ones included.
        ready_s: To load applications and worlds, and to place robots, compiling apart.
        compile_s: To trace and compile programs, or to load what was compiled.
        slices: How many slices of control steps there were.
        slices_s: What those took, compiling apart.
        peak_bytes: The most memory that the process held until then.
        gl: Which GL drew what its colour cameras saw; empty if none did.
    """

    lanes: int
    ready_s: float
    compile_s: float
    slices: int
    slices_s: float
    peak_bytes: int
    gl: Annotated[str, Field(max_length=200, pattern="^[ -~]*$")] = ""


_collected_timings: ContextVar[tuple[list[ChunkTiming], ...]] = ContextVar("simyard_chunk_timings", default=())


class _Mark(NamedTuple):
    """A time, and what a thread had compiled for until then."""

    at_s: float
    thread: int
    compiled_s: float


class ChunkWatch:
    """Takes the times of a chunk, whose later slices another thread may drive than made it ready."""

    def __init__(self) -> None:
        """Begins now."""
        self._last, self._compile_s = _mark(), 0.0
        self._running_s: list[float] = []

    def mark(self) -> None:
        """Notes the time: when lanes are ready, then at the end of each slice."""
        before, self._last = self._last, _mark()
        same = before.thread == self._last.thread
        compile_s = self._last.compiled_s - before.compiled_s if same else 0.0
        self._compile_s += compile_s
        self._running_s.append(self._last.at_s - before.at_s - compile_s)

    def timing(self, lanes: int, gl: str = "") -> ChunkTiming | None:
        """Returns what the chunk took; None of one that was not driven.

        Args:
            lanes: Of the program, idle ones included.
            gl: Which GL drew for it.
        """
        if len(self._running_s) <= 1:
            return None
        ready_s, *slices_s = self._running_s
        return ChunkTiming(
            lanes=lanes,
            ready_s=ready_s,
            compile_s=self._compile_s,
            slices=len(slices_s),
            slices_s=sum(slices_s),
            peak_bytes=peak_bytes(),
            gl=gl,
        )


class TurnWatch:
    """Takes the times of chunks that share lanes: what went by from the end of one to the end of the next."""

    def __init__(self) -> None:
        """Begins at zero."""
        self._ready_s, self._slices_s = 0.0, list[float]()
        self._compiled_s = compiled_s()

    def placed(self, took_s: float) -> None:
        """Adds time in which nothing but placing was done, compiling apart."""
        self._ready_s += took_s

    def drove(self, took_s: float) -> None:
        """Adds a slice, with what had to be done before it, compiling apart."""
        self._slices_s.append(took_s)

    def timing(self, lanes: int) -> ChunkTiming | None:
        """Returns what the chunk took, as ``ChunkWatch.timing``; None of one that no slice was driven for."""
        if not self._slices_s:
            return None
        return ChunkTiming(
            lanes=lanes,
            ready_s=self._ready_s,
            compile_s=compiled_s() - self._compiled_s,
            slices=len(self._slices_s),
            slices_s=sum(self._slices_s),
            peak_bytes=peak_bytes(),
        )


def peak_bytes() -> int:
    """Returns the most memory that this process held until now."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _PEAK_UNIT


def _mark() -> _Mark:
    return _Mark(monotonic(), get_ident(), compiled_s())


@contextmanager
def collect_timings() -> Generator[list[ChunkTiming], None, None]:
    """Yields a list that gets the timing of each chunk that comes to its end inside the ``with`` block."""
    timings: list[ChunkTiming] = []
    token = _collected_timings.set((*_collected_timings.get(), timings))
    try:
        yield timings
    finally:
        _collected_timings.reset(token)


def note_timing(timing: ChunkTiming | None) -> None:
    """Adds what a chunk took to what is collected, if anybody collects; of one that was not driven, nothing."""
    if timing is not None:
        for timings in _collected_timings.get():
            timings.append(timing)


JobTags = dict[int, dict[str, str]]
"""Tags by the index of the episode."""

_collected_tags: ContextVar[JobTags | None] = ContextVar("simyard_job_tags", default=None)


@contextmanager
def collect_tags() -> Generator[JobTags, None, None]:
    """Yields what gets all tags that are given inside the ``with`` block."""
    tags: JobTags = {}
    token = _collected_tags.set(tags)
    try:
        yield tags
    finally:
        _collected_tags.reset(token)


def give_tags(index: int, tags: Mapping[str, str]) -> None:
    """Adds the tags of an episode's job to what is collected, if anybody collects."""
    collecting = _collected_tags.get()
    if collecting is not None and tags:
        collecting.setdefault(index, {}).update(tags)
