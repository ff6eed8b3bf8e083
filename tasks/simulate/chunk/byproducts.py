"""What comes of a chunk besides its rows: the times that it took, and the tags that applications gave to their jobs.

The last timings of a program are kept in the user's cache folder for `simyard plan` to predict with. Nothing of them is
ever part of a result. A folder that cannot be written to, or a file of another version, is as good as no memory at all.

Tags are on their way to whoever keeps them. Whoever simulates without a wish for tags, such as an audit, loses nothing
by leaving them.
"""

import hashlib
import logging
import resource
import sys
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from threading import get_ident
from time import monotonic
from typing import NamedTuple

from pydantic import TypeAdapter, ValidationError

from specs.base import Spec
from specs.field_types import EngineName
from tasks.simulate.devices import compiled_s, device_kind
from tasks.simulate.plan.chunks import ProgramKey
from tasks.storage.base.local_files import cache_folder, whole_file

logger = logging.getLogger(__name__)
_KEPT = 12
# Linux counts in kibibytes, macOS in bytes.
_PEAK_UNIT = 1 if sys.platform == "darwin" else 1024


class ChunkTiming(Spec):
    """What one chunk took that came to its end.

    Attributes:
        lanes: Of the program, idle ones included.
        episodes: How many of them held episodes.
        ready_s: To load applications and worlds, and to place robots, compiling apart.
        compile_s: To trace and compile programs, or to load what was compiled.
        slices: How many slices of control steps there were.
        slices_s: What those took, compiling apart.
        most_slices: How many there would have been if an episode had taken its full duration.
        peak_bytes: The most memory that the process held until then.
        host: Whether controllers ran on the host, which says little of programs without.
    """

    engine: EngineName
    device: str
    lanes: int
    episodes: int
    ready_s: float
    compile_s: float
    slices: int
    slices_s: float
    most_slices: int
    peak_bytes: int
    host: bool = False


_TIMINGS = TypeAdapter(list[ChunkTiming])
_collected_timings: ContextVar[list[ChunkTiming] | None] = ContextVar("simyard_chunk_timings", default=None)
_handed_over: ContextVar[list[tuple[ProgramKey, ChunkTiming]] | None] = ContextVar("simyard_timings_over", default=None)


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

    def timing(
        self, engine: EngineName, device: str, *, lanes: int, episodes: int, most_slices: int, host: bool = False
    ) -> ChunkTiming | None:
        """Returns what the chunk took; None of one that was not driven.

        Args:
            engine: What drove it.
            device: The kind of device.
            lanes: Of the program, idle ones included.
            episodes: How many of them held episodes.
            most_slices: How many slices there would have been if an episode had taken its full duration.
            host: Whether controllers ran on the host.
        """
        if len(self._running_s) <= 1:
            return None
        ready_s, *slices_s = self._running_s
        return ChunkTiming(
            engine=engine,
            device=device,
            lanes=lanes,
            episodes=episodes,
            ready_s=ready_s,
            compile_s=self._compile_s,
            slices=len(slices_s),
            slices_s=sum(slices_s),
            most_slices=most_slices,
            peak_bytes=peak_bytes(),
            host=host,
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

    def timing(self, engine: EngineName, *, lanes: int, episodes: int, most_slices: int) -> ChunkTiming | None:
        """Returns what the chunk took; None of one that no slice was driven for. The rest as ``ChunkWatch.timing``."""
        if not self._slices_s:
            return None
        return ChunkTiming(
            engine=engine,
            device=device_kind(),
            lanes=lanes,
            episodes=episodes,
            ready_s=self._ready_s,
            compile_s=compiled_s() - self._compiled_s,
            slices=len(self._slices_s),
            slices_s=sum(self._slices_s),
            most_slices=most_slices,
            peak_bytes=peak_bytes(),
        )


def peak_bytes() -> int:
    """Returns the most memory that this process held until now."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _PEAK_UNIT


def _mark() -> _Mark:
    return _Mark(monotonic(), get_ident(), compiled_s())


@contextmanager
def collect_timings() -> Generator[list[ChunkTiming], None, None]:
    """Yields a list that gets each timing which is remembered inside the ``with`` block."""
    timings: list[ChunkTiming] = []
    token = _collected_timings.set(timings)
    try:
        yield timings
    finally:
        _collected_timings.reset(token)


@contextmanager
def hand_over_timings() -> Generator[list[tuple[ProgramKey, ChunkTiming]], None, None]:
    """Yields a list that gets each timing instead of the cache folder, for a process that may not write there."""
    timings: list[tuple[ProgramKey, ChunkTiming]] = []
    token = _handed_over.set(timings)
    try:
        yield timings
    finally:
        _handed_over.reset(token)


def remember_timing(program: ProgramKey, timing: ChunkTiming) -> None:
    """Adds a timing to the last ones of a program, for as long as the cache folder is kept."""
    over = _handed_over.get()
    if over is not None:
        over.append((program, timing))
        return
    took_s = timing.ready_s + timing.compile_s + timing.slices_s
    logger.debug("%d episodes on %s in %.1f s", timing.episodes, timing.engine, took_s)
    collecting = _collected_timings.get()
    if collecting is not None:
        collecting.append(timing)
    path = _timings_file(program)
    try:
        with whole_file(path) as file:
            file.write(_TIMINGS.dump_json([*_read_timings(path), timing][-_KEPT:]))
    except OSError as exc:
        logger.debug("timings are not remembered: %s", exc)


def recall_timings(program: ProgramKey) -> list[ChunkTiming]:
    """Returns the last timings of a program on this machine, oldest first."""
    return _read_timings(_timings_file(program))


def recall_engine_timings(engine: str, device: str, *, host: bool = False) -> list[ChunkTiming]:
    """Returns the last timings of all programs that an engine ran on this machine, with or without the host."""
    found = (timing for path in sorted(_timings_folder().glob("*.json")) for timing in _read_timings(path))
    return [timing for timing in found if (timing.engine, timing.device, timing.host) == (engine, device, host)]


def _read_timings(path: Path) -> list[ChunkTiming]:
    try:
        return _TIMINGS.validate_json(path.read_bytes())
    except (OSError, ValidationError):
        return []


def _timings_folder() -> Path:
    return cache_folder() / "timings"


def _timings_file(program: ProgramKey) -> Path:
    return _timings_folder() / f"{hashlib.sha256(repr(program).encode()).hexdigest()}.json"


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
