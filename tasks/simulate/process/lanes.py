"""Episodes simulated in a process of their own: whatever becomes of it, each episode has its row.

A process that an application ended, or that hung in one, is followed by another, and what it was simulating is
simulated in halves: so the episodes that are to blame are found, and the rows of the others are what they would be
without these. Where that would take too many processes, the rest fails with the last one's reason.
"""

import functools
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from specs.data.column_bytes import decode_columns
from specs.data.episode import (
    CONTROL_HZ,
    EpisodeRequest,
    EpisodeResult,
    Failure,
    failed_result,
    unfinished_result,
)
from specs.data.episode_columns import EpisodeColumns
from specs.data.world import World
from tasks.simulate.application.code import crash_code
from tasks.simulate.chunk.job_tags import JobTags
from tasks.simulate.chunk.memory_fit import TooManyLanes
from tasks.simulate.host.host_lanes import most_lanes
from tasks.simulate.lane.recording import Recorder
from tasks.simulate.lane.recording_choice import RecordingChoice
from tasks.simulate.plan.chunks import SLICE_STEPS, Chunk, ProgramKey
from tasks.simulate.process.simulator import Simulator, SimulatorEnded
from tasks.simulate.process.simulators import simulator
from tasks.simulate.process.told_run import ToldRun
from tasks.simulate.process.work import (
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

logger = logging.getLogger(__name__)
_MOST_ENDINGS = 12
# How often a process may record an episode for one answer: beside others, and, if one of those fails, by itself.
_RECORDED_AT_MOST = 2
# Applications, lanes and engine of batches for whose chunks together the memory was too little: it would be again.
_too_large_together: set[tuple[frozenset[str], int, str]] = set()


@dataclass
class ConfinedLanes:
    """Simulates parts of chunks in a process of their own; takes what ``chunk.runner.simulate_columns`` takes.

    Attributes:
        bundles: Unpacked folders of the applications, by digest.
        lanes: How many lanes every chunk of the batch is padded to.
        engine: ``auto``, or the engine that must run them.
        should_stop: Asked several times a second; episodes not done by then are Canceled.
        progress: Told how many of the part's episodes are done.
        rate_hz: Of the recorder's samples.
        recorder: Given what the lanes do, unless a process ended over it.
        timed_as: Program to remember the time for.
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
    timed_as: ProgramKey | None = None
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
        batch = (frozenset(self.bundles), self.lanes, self.engine)
        try:
            return self._rows(chunk, worlds, self.recorder, () if batch in _too_large_together else self.ahead)
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
        if len(requests) == 1 or ended.importing or self._endings >= _MOST_ENDINGS:
            return _failed(requests, ended)
        half = len(requests) // 2
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
        with simulator(self.bundles) as process:
            chunks = (chunk, *ahead)
            used = dict.fromkeys(request.world for each in chunks for request in each.requests)
            work = LanesWork(
                numbers=tuple(each.number for each in chunks),
                new=process.new_chunks(chunks),
                worlds=process.sent_worlds({name: worlds[name] for name in used if name in worlds}),
                bundles={digest: str(folder) for digest, folder in self.bundles.items()},
                lanes=self.lanes,
                engine=self.engine,
                timed_as=self.timed_as,
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
        self._most_steps = _most_steps(requests)
        self._run: ToldRun | None = None
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
            self._run = ToldRun(answer, min(len(self._wanted), self._lanes_left), self._most_steps)
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


def _most_steps(requests: Sequence[EpisodeRequest]) -> int:
    """Returns how many control steps a recording of some episodes has at most, which ends with a slice."""
    longest_s = max(request.duration_s for request in requests)
    return SLICE_STEPS * (1 + round(longest_s * CONTROL_HZ) // SLICE_STEPS)


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
