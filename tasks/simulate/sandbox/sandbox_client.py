"""A chunk of episodes simulated in a process of its own: whatever becomes of it, each episode has its row.

A process that an application ended, or that hung in one, is followed by another, and what it was simulating is
simulated in halves: so the episodes that are to blame are found, and the rows of the others are what they would be
without these. Where that would take too many processes, the rest fails with the last one's reason.

A chunk that does not fit into memory is tried again with fewer lanes, half as many each time, until they fit. A lane's
result does not depend on how many lanes run beside it (docs/decisions/0004), so neither the chunk's rows nor what is
committed changes.

What a process tells a recorder of its lanes is checked: only what the recorder can take is let pass.
"""

import functools
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from specs.data.column_bytes import decode_columns
from specs.data.episode import EpisodeRequest, EpisodeResult, Failure, failed_result, unfinished_result
from specs.data.episode_columns import EpisodeColumns
from specs.data.world import World
from tasks.simulate.application.bundle_code import crash_code
from tasks.simulate.chunk.byproducts import JobTags
from tasks.simulate.host.declaration import FEWEST_LANES, most_lanes
from tasks.simulate.lane.recording import Ends, Recorder, RecordingChoice, SliceSamples
from tasks.simulate.plan.batch_plan import whole_groups
from tasks.simulate.plan.chunks import Chunk, most_steps
from tasks.simulate.sandbox.process_pool import simulator
from tasks.simulate.sandbox.protocol import (
    LONGEST_SIDES,
    WIDEST,
    Answer,
    Crashed,
    LanesWork,
    NoMemory,
    Progress,
    RecordingBegins,
    RecordingEnds,
    Rows,
    Samples,
)
from tasks.simulate.sandbox.simulator import Simulator, SimulatorEnded

logger = logging.getLogger(__name__)
Results = Sequence[EpisodeResult] | EpisodeColumns
SimulatePart = Callable[[Chunk, int], Results]


class TooManyLanes(MemoryError):  # noqa: N818 - a state
    """So many lanes would not fit, which is known before they are tried.

    Attributes:
        most: How many do.
    """

    def __init__(self, why: str, most: int) -> None:
        self.most = most
        super().__init__(why)


class _Lack(NamedTuple):
    """Why lanes did not fit, and how many do where that is known; 0 where it is not."""

    why: str
    most: int = 0


class FittedChunk(NamedTuple):
    """A chunk's rows in request order, and how many lanes fitted."""

    rows: EpisodeColumns
    lanes: int


def retry_with_fewer_lanes(
    chunk: Chunk, lanes: int, simulate: SimulatePart, stopped: Callable[[], bool]
) -> FittedChunk:
    """Returns a chunk's rows, simulated with as many lanes at a time as the memory holds.

    Args:
        chunk: The chunk.
        lanes: Most lanes to try.
        simulate: Runs a part of the chunk with so many lanes.
        stopped: Whether the rest shall not be begun.

    Raises:
        Exception: Whatever else than a lack of memory goes wrong.
    """
    parts: list[EpisodeColumns] = []
    robots = chunk.requests[0].sharing if chunk.requests else 1
    while (done := sum(map(len, parts))) < len(chunk.requests):
        part = chunk.requests[done : done + whole_groups(lanes, robots)]
        if parts and stopped():
            parts.append(EpisodeColumns.of(_not_begun(part)))
            continue
        found = _tried(chunk.model_copy(update={"requests": part}), lanes, simulate)
        if not isinstance(found, _Lack):
            parts.append(EpisodeColumns.of(found))
        elif lanes > FEWEST_LANES:
            lanes = max(FEWEST_LANES, found.most or lanes // 2)
            logger.warning("chunk %d: going on with %d lanes at a time: %s", chunk.number, lanes, found.why)
        else:
            parts.append(EpisodeColumns.of(_out_of_memory(part, found.why)))
    return FittedChunk(EpisodeColumns.join(parts), lanes)


def after_deaths(lanes: int, attempts: int) -> int:
    """Returns how many lanes to begin a chunk with whose process died so often: the kernel may have ended it.

    The first death is taken for an accident.
    """
    return max(min(lanes, FEWEST_LANES), lanes >> max(0, attempts - 2))


def _not_begun(requests: Sequence[EpisodeRequest]) -> list[EpisodeResult]:
    return [unfinished_result(request.index, "Canceled", failure_code="", failure_reason="") for request in requests]


def _tried(chunk: Chunk, lanes: int, simulate: SimulatePart) -> Results | _Lack:
    """Returns rows, or what the lack of memory was called; what it held is free again then."""
    try:
        return simulate(chunk, lanes)
    except TooManyLanes as exc:
        return _Lack(str(exc), exc.most)
    except MemoryError as exc:
        return _Lack(f"out of memory: {exc}")
    except RuntimeError as exc:
        if "RESOURCE_EXHAUSTED" not in str(exc):  # XLA's status for an allocation that failed
            raise
        return _Lack(f"out of memory: {exc}")


def _out_of_memory(requests: Sequence[EpisodeRequest], lack: str) -> list[EpisodeResult]:
    why = " ".join(lack.removeprefix("out of memory: ").split())[:500]
    reason = f"out of memory even with {FEWEST_LANES} lanes: {why}"
    return [failed_result(request.index, Failure("InternalServiceError", reason)) for request in requests]


# The sides of arrays: a number, up to one for each step (?), or a name for one that is the same wherever it stands. All
# have a lane first; lanes beyond those that hold episodes may follow.
_SAMPLES = (
    "? 3",
    "? velocity",
    "?",
    "? controls",
    "? rays",
    "controls",
    "rays",
    "steps",
    "? people 2",
    "? robots 2",
    "? boxes 2",
)
_ENDS = (
    "",
    "",
    "3",
    "3",
    "velocity",
    "",
    "goals 2",
    "7",
    "people 2",
    "people 2",
    "robots 2",
    "robots 2",
    "boxes 2",
    "boxes 2",
)


class RecordingCheck:
    """A run of lanes, as a process tells it."""

    def __init__(self, begins: RecordingBegins, most: int, most_steps: int) -> None:
        """Begins without samples.

        Args:
            begins: Says how many lanes hold episodes.
            most: How many can at most.
            most_steps: How many control steps they can do at most.

        Raises:
            ValueError: No run begins so.
        """
        if not (0 < begins.lanes <= most and 0.0 < begins.control_s < math.inf):
            raise ValueError(f"a recording of {begins.lanes} lanes with steps of {begins.control_s} s")
        self._lanes, self._steps, self._sides = begins.lanes, 0, dict[str, int]()
        self._most_steps = most_steps

    def samples(
        self, told: Samples, arrays: Sequence[np.ndarray]
    ) -> tuple[SliceSamples, Int[np.ndarray, "lanes"]]:  # fmt: skip
        """Returns the samples of a slice, and how many steps each lane has done.

        Raises:
            ValueError: They are none.
        """
        self._steps += told.steps
        if not (0 < told.steps <= self._steps <= self._most_steps):
            raise ValueError(f"a recording that goes on for {self._steps} steps")
        self._sides["steps"] = told.steps
        self._check(arrays, (*_SAMPLES, ""), most=told.steps)
        _check_counts(arrays[2])
        return SliceSamples(told.steps, *(array[: self._lanes] for array in arrays[:-1])), arrays[-1]

    def ends(self, rows: EpisodeColumns, arrays: Sequence[np.ndarray]) -> Ends:
        """Returns how the lanes ended.

        Args:
            rows: The lanes' results.
            arrays: The rest of what was told.

        Raises:
            ValueError: So they cannot have ended.
        """
        self._check(arrays, _ENDS)
        ends = Ends(*arrays)
        _check_counts(ends.steps, ends.goal_index)
        if len(rows) != self._lanes or ends.steps.max() > self._steps or not self._sides["goals"]:
            raise ValueError("a recording that ends otherwise than it went")
        return ends

    def _check(self, arrays: Sequence[np.ndarray], forms: Sequence[str], most: int = 0) -> None:
        for array, form in zip(arrays, forms, strict=True):
            lanes, sides = array.shape[:1], array.shape[1:]
            if not lanes or lanes[0] < self._lanes:
                raise ValueError("a recording that lacks lanes")
            if array.dtype.itemsize > WIDEST:
                raise ValueError("a recording of numbers that no engine has")
            for side, name in zip(sides, form.split(), strict=True):
                if not self._fits(side, name, most):
                    raise ValueError("a recording with arrays of other sides")

    def _fits(self, side: int, name: str, most: int) -> bool:
        if name == "?":
            return side <= most
        if name.isdecimal():
            return side == int(name)
        return side <= LONGEST_SIDES.get(name, side) and side == self._sides.setdefault(name, side)


def _check_counts(*arrays: np.ndarray) -> None:
    if any(array.dtype.kind not in "iu" or array.min(initial=0) < 0 for array in arrays):
        raise ValueError("a recording with counts that are none")


_MOST_ENDINGS = 12
# How often a process may record an episode for one answer: beside others, and, if one of those fails, by itself.
_RECORDED_AT_MOST = 2
# Applications, lanes and engine of batches for whose chunks together the memory was too little: it would be again.
_too_large_together: set[tuple[frozenset[str], int, str]] = set()


@dataclass
class SandboxClient:
    """Simulates parts of chunks in a process of their own; takes what ``chunk_simulation.simulate_episodes`` takes.

    Attributes:
        bundles: Unpacked folders of the batch's applications, by digest; a process gets those that its chunk runs.
        lanes: How many lanes every chunk of the batch is padded to.
        engine: ``auto``, or the engine that must run them.
        should_stop: Asked several times a second; episodes not done by then are Canceled.
        progress: Told how many of the part's episodes are done.
        rate_hz: Of the recorder's samples.
        recorder: Given what the lanes do, unless a process ended over it.
        printed: Given what applications print.
        tagged: Given the tags that applications gave to their jobs, by the index of the episode.
        ahead: Chunks that are going to be simulated next, in their order; the process begins them when lanes are free.
        recorded: Which episodes the recorder keeps at most; None means that it may keep any.
    """

    bundles: Mapping[str, Path]
    lanes: int
    engine: str
    should_stop: Callable[[], bool]
    progress: Callable[[int], None] = lambda _: None
    rate_hz: float = 1.0
    recorder: Recorder | None = None
    printed: Callable[[str], None] = lambda _: None
    tagged: Callable[[JobTags], None] = lambda _: None
    ahead: Sequence[Chunk] = ()
    recorded: RecordingChoice | None = None
    _endings: int = field(default=0, init=False)

    def simulate(self, chunk: Chunk, worlds: Mapping[str, World]) -> EpisodeColumns:
        """Returns the rows of a part of a chunk, in request order.

        Raises:
            MemoryError: There is not enough memory for so many lanes.
            SimulatorDefect: The process met a defect of Simyard's.
        """
        most, asked = most_lanes(chunk.requests, self.bundles), len(chunk.requests)
        if most is not None and asked > most:
            raise TooManyLanes(
                f"{asked} ROS applications at once are too many for this machine's memory and cores", most
            )
        try:
            return self._beside_others(chunk, worlds)
        except SimulatorEnded as ended:
            return self._after(ended, chunk, worlds)

    def _beside_others(self, chunk: Chunk, worlds: Mapping[str, World]) -> EpisodeColumns:
        """Returns the rows; if the process ends, the chunks ahead may be to blame, and it is asked again without."""
        own = _bundles_of(chunk)
        batch, ahead = (own, self.lanes, self.engine), [each for each in self.ahead if _bundles_of(each) <= own]
        try:
            return self._rows(chunk, worlds, self.recorder, () if batch in _too_large_together else ahead)
        except SimulatorEnded as ended:
            if ended.killed == "stop" or not ended.beside_others:
                raise
            if ended.out_of_memory:
                _too_large_together.add(batch)
            logger.warning("chunk %d: %s; once more, without the chunks after it", chunk.number, ended.reason)
        recorder = self.recorder if self.recorder and self.recorder.untouched else None
        return self._rows(chunk, worlds, recorder)

    def _after(self, ended: SimulatorEnded, chunk: Chunk, worlds: Mapping[str, World]) -> EpisodeColumns:
        """Returns the rows of a part whose process ended."""
        if ended.out_of_memory:
            raise MemoryError(ended.reason)
        requests, self._endings = chunk.requests, self._endings + 1
        if ended.killed == "stop" or (self._endings > 1 and self.should_stop()):
            return EpisodeColumns.of([_stopped(request) for request in requests])
        logger.warning("chunk %d: %s", chunk.number, ended.reason)
        robots = requests[0].sharing
        if len(requests) <= robots or ended.importing or self._endings >= _MOST_ENDINGS:
            return _failed(requests, ended)
        half = whole_groups(len(requests) // 2, robots)
        parts = (requests[:half], requests[half:])
        return EpisodeColumns.join(
            [self._half(chunk.model_copy(update={"requests": part}), worlds, ended) for part in parts]
        )

    def _half(self, chunk: Chunk, worlds: Mapping[str, World], before: SimulatorEnded) -> EpisodeColumns:
        if self._endings >= _MOST_ENDINGS:
            return _failed(chunk.requests, before)
        try:
            return self._rows(chunk, worlds, None)
        except SimulatorEnded as ended:
            return self._after(ended, chunk, worlds)

    def _rows(
        self, chunk: Chunk, worlds: Mapping[str, World], recorder: Recorder | None, ahead: Sequence[Chunk] = ()
    ) -> EpisodeColumns:
        own = _bundles_of(chunk)
        bundles = {digest: folder for digest, folder in self.bundles.items() if digest in own}
        with simulator(bundles) as process:
            chunks = (chunk, *ahead)
            used = dict.fromkeys(request.world for each in chunks for request in each.requests)
            work = LanesWork(
                numbers=tuple(each.number for each in chunks),
                new=process.new_chunks(chunks),
                worlds=process.sent_worlds({name: worlds[name] for name in used if name in worlds}),
                bundles={digest: str(folder) for digest, folder in bundles.items()},
                lanes=self.lanes,
                engine=self.engine,
                rate_hz=self.rate_hz if recorder else None,
                recorded=self.recorded,
            )
            hear = _Listener(process, self.progress, recorder, chunk.requests)
            try:
                last, arrays = process.ask(work, on_answer=hear, should_stop=self.should_stop)
                if isinstance(last, Rows):
                    hear.take(arrays)
            finally:
                self.printed(process.output.take())
            rows = _checked(process, chunk.requests, last, hear.rows)
        if isinstance(last, Rows) and last.tags:
            known = {request.index for request in chunk.requests}
            self.tagged({index: tags for index, tags in last.tags.items() if index in known})
        return rows


def _bundles_of(chunk: Chunk) -> frozenset[str]:
    """Returns the digests of what a chunk runs, and with it one process: no robot's code is beside another's."""
    return frozenset(digest for request in chunk.requests for digest in request.bundles)


class _Listener:
    """Hears what a process says while it simulates.

    Attributes:
        rows: Those that it has told, by recording, and at the end the others.
    """

    def __init__(
        self,
        process: Simulator,
        progress: Callable[[int], None],
        recorder: Recorder | None,
        requests: Sequence[EpisodeRequest],
    ) -> None:
        self._process, self._progress, self._recorder = process, progress, recorder
        self._wanted = [request.index for request in requests]
        self._most_steps = most_steps(requests)
        self._run: RecordingCheck | None = None
        self._lanes_left = _RECORDED_AT_MOST * len(self._wanted)
        self.rows: list[EpisodeColumns] = []

    def __call__(self, answer: Answer, arrays: tuple[np.ndarray, ...]) -> None:
        if isinstance(answer, Progress):
            self._progress(answer.done)
        elif self._recorder is not None:
            try:
                self._record(self._recorder, answer, arrays)
            except ValueError as exc:
                raise self._process.refused(exc) from None

    def _record(self, recorder: Recorder, answer: Answer, arrays: tuple[np.ndarray, ...]) -> None:
        """Tells the recorder what was said.

        Raises:
            ValueError: No recorder can be told that.
        """
        if isinstance(answer, RecordingBegins):
            self._run = RecordingCheck(answer, min(len(self._wanted), self._lanes_left), self._most_steps)
            self._lanes_left -= answer.lanes
            recorder.begin(answer.lanes, answer.control_s)
        elif self._run is None:
            raise ValueError("samples of no recording")
        elif isinstance(answer, Samples):
            recorder.add(*self._run.samples(answer, arrays))
        elif isinstance(answer, RecordingEnds):
            rows = self.take(arrays)
            if not np.isin(rows.index, self._wanted).all():
                raise ValueError("a recording of other episodes")
            recorder.end(self._run.ends(rows, arrays[1:]), rows)
            self._run = None

    def take(self, arrays: Sequence[np.ndarray]) -> EpisodeColumns:
        """Returns the rows that an answer begins with, and keeps them.

        Raises:
            SimulatorEnded: There are none; the process is ended.
        """
        try:
            found = decode_columns(arrays[0].tobytes())
        except (ValueError, IndexError) as exc:
            raise self._process.refused(exc) from None
        self.rows.append(found)
        return found


def _checked(
    process: Simulator, requests: Sequence[EpisodeRequest], last: Answer, told: Sequence[EpisodeColumns]
) -> EpisodeColumns:
    """Returns the rows that a process told, if its last answer is that and they are those of the requests.

    Args:
        process: That was asked.
        requests: What it was asked for.
        last: Its last answer.
        told: The rows that came with its answers.

    Raises:
        MemoryError: It answered that there is not enough memory.
        SimulatorEnded: It answered anything else; the process is ended.
    """
    if isinstance(last, NoMemory):
        raise MemoryError(last.text)  # noqa: TRY004 - it is no wrong type
    if isinstance(last, Crashed):
        failure = Failure(last.code, last.reason)
        return EpisodeColumns.of([failed_result(request.index, failure) for request in requests])
    wanted = np.array([request.index for request in requests], np.int64)
    none = EpisodeColumns.of([])
    rows = functools.reduce(EpisodeColumns.renewed, told, none) if isinstance(last, Rows) else none
    if not np.array_equal(np.sort(rows.index), np.sort(wanted)):
        raise process.broke_off("it answered with rows of other episodes")
    # Which file has a recording is said by whoever writes it.
    return rows.at(wanted).marked("recording", np.ones(len(wanted), np.bool_), "")


def _failed(requests: Sequence[EpisodeRequest], ended: SimulatorEnded) -> EpisodeColumns:
    failure = Failure(crash_code(ended.code), ended.reason)
    return EpisodeColumns.of([failed_result(request.index, failure) for request in requests])


def _stopped(request: EpisodeRequest) -> EpisodeResult:
    return unfinished_result(request.index, "Canceled", failure_code="", failure_reason="stopped before its end")
