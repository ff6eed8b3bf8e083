"""Runs one chunk of a batch: makes it ready, has its episodes simulated, and commits their results.

They are simulated in a process that has neither keys nor a way to the store. What their applications ask for besides,
tags of their jobs, is done here. The chunks that come next are made ready before it is their turn.
"""

import functools
import itertools
import logging
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import NamedTuple, cast

import numpy as np
from jaxtyping import Bool

from specs.arn import ArnForm, Reference
from specs.data.episode import EpisodeRequest, Failure, failed_result
from specs.data.episode_columns import EpisodeColumns
from specs.data.outcomes import MOST_OWN_TAGS
from specs.data.world import World
from specs.errors import DocumentError, SimyardError
from specs.settings import region
from specs.untrusted_text import terminal_line
from tasks.simulate.batch.batch_record import OpenBatch, StopWatch, time_out
from tasks.simulate.batch.chunk_store import begin_chunk, commit, stored_chunk
from tasks.simulate.batch.metrics import ChunkWork, work_of
from tasks.simulate.batch.provenance import note_gl
from tasks.simulate.chunk.byproducts import JobTags, collect_timings
from tasks.simulate.data.mounts import Mounts, pinned_worlds
from tasks.simulate.lane.recording import Columns, Recorder, RecordingChoice, sample_memory
from tasks.simulate.plan.chunks import Chunk, job_variables
from tasks.simulate.plan.plan_batch import entries
from tasks.simulate.sandbox.sandbox_client import Results, SandboxClient, after_deaths, retry_with_fewer_lanes
from tasks.storage.base.local_files import cache_folder
from tasks.storage.store_url import store_id
from tasks.storage.tags import change_tags, with_tags

logger = logging.getLogger(__name__)
# Deliveries rest for half of a chunk's time: with one chunk ahead lanes would still rest, a third would find none.
_AHEAD = 2
# Chunks are made ready while those before them drive, and asked for again when it is their turn.
_EARLY = 4


class PreparedChunk(NamedTuple):
    """A chunk, and what of it can be simulated.

    Attributes:
        asked: As the plan has it.
        able: The episodes that can be simulated, with the folders of their data sources.
        worlds: Theirs.
        unable: Why others cannot, by index.
    """

    asked: Chunk
    able: Chunk
    worlds: dict[str, World]
    unable: dict[int, Failure]


_early: OrderedDict[tuple[str, str, int], PreparedChunk] = OrderedDict()
_turn = Lock()  # two runs in one process make chunks ready


def prepared_chunk(batch: OpenBatch, number: int, unusable: Mapping[str, Failure]) -> PreparedChunk:
    """Returns a chunk, and what of it can be simulated.

    Args:
        batch: The batch.
        number: The chunk's.
        unusable: Why episodes fail that need an application whose bundle cannot be used, by its digest.
    """
    key = (batch.store.url, batch.id, number)
    with _turn:
        early = None if unusable else _early.get(key)
    if early is not None:
        return early
    chunk, mounted = batch.layout.chunk(number), batch_mounts(batch)
    worlds, missing = load_worlds(batch, chunk.requests)
    why = {
        each.index: missing.get(each.world)
        or mounted.failure(each)
        or unusable.get(each.robot.digest)
        or unusable.get(each.scenario.digest)
        for each in chunk.requests
    }
    unable = {index: failure for index, failure in why.items() if failure}
    able = (mounted.resolved(each) for each in chunk.requests if each.index not in unable)
    found = PreparedChunk(chunk, chunk.model_copy(update={"requests": tuple(able)}), worlds, unable)
    if not unable and not batch.plan.data_sources:  # whose files may be away the next time
        with _turn:
            _early[key] = found
            while len(_early) > _EARLY:
                _early.popitem(last=False)
    return found


def forget_chunks(batch: OpenBatch) -> None:
    """Forgets a batch's chunks that were made ready early, for which nobody is going to ask."""
    with _turn:
        for key in [key for key in _early if key[:2] == (batch.store.url, batch.id)]:
            del _early[key]


def batch_mounts(batch: OpenBatch) -> Mounts:
    """Returns the data sources of a batch on this machine, and what its applications are told of their jobs."""
    variables = functools.partial(job_variables, ArnForm(store_id(batch.store), region()), batch.id)
    return Mounts(batch.store, batch.plan.data_sources, cache_folder() / "data", variables)


def load_worlds(batch: OpenBatch, requests: Iterable[EpisodeRequest]) -> tuple[dict[str, World], dict[str, Failure]]:
    """Returns the episodes' worlds, and why others of them cannot be used."""
    return pinned_worlds(batch.store.url, batch.plan.world_digests, requests)


def chunks_ahead(numbers: Sequence[int]) -> tuple[int, ...]:
    """Returns the chunks to make ready while one drives, of those that are going to be run after it."""
    return tuple(numbers[:_AHEAD])


def coming_chunks(
    batch: OpenBatch, numbers: Iterable[int], unusable: Mapping[str, Failure]
) -> Callable[[], list[PreparedChunk]]:
    """Returns what returns the next chunks of a batch of which anything can be simulated, made ready once.

    What keeps one from being made ready is told to the log, and neither it nor those after it are returned: the chunk
    that drives meanwhile has no part in that.

    Args:
        batch: The batch.
        numbers: Of chunks that are going to be run, in their order.
        unusable: Why episodes fail that need an application whose bundle cannot be used, by its digest.
    """

    @functools.cache
    def coming() -> list[PreparedChunk]:
        return list(_ready_early(batch, numbers, unusable))

    return coming


def _ready_early(
    batch: OpenBatch, numbers: Iterable[int], unusable: Mapping[str, Failure]
) -> Generator[PreparedChunk, None, None]:
    for number in numbers:
        try:
            found = prepared_chunk(batch, number, unusable)
        except (SimyardError, OSError) as exc:  # if it lasts, its own run meets it, and says so
            logger.warning("chunk %d does not begin early: %s", number, terminal_line(str(exc)))
            return
        if not found.able.requests:
            return
        yield found


# Different reasons why jobs of a chunk failed that the log gets, the most frequent first.
_REASONS_TOLD = 3


class ChunkPart(NamedTuple):
    """What is simulated at a time: a chunk, or what of it fits into memory.

    Attributes:
        lanes: How many lanes to simulate it with.
        watch: Says when to stop.
        recorder: Is given what the lanes do; None if nothing of the batch is recorded.
        whole: Whether it is all of a chunk that can be simulated.
        recorded: Which of its episodes the recorder keeps, if they are not cancelled.
        coming: Chunks that are going to be run next, in their order, where the runner does not know them.
    """

    chunk: Chunk
    worlds: Mapping[str, World]
    lanes: int
    watch: StopWatch
    recorder: Recorder | None
    whole: bool = False
    recorded: RecordingChoice | None = None
    coming: Sequence[PreparedChunk] = ()


Simulate = Callable[[ChunkPart], Results]
# Writes the recordings of the chunk with that number, over what may be there, and returns the name of their file; an
# empty name if there are none.
WriteRecordings = Callable[[int, Iterable[Columns]], str]


class ChunkEnd(NamedTuple):
    """How a chunk ended.

    Attributes:
        episodes: How many it has.
        lanes: How many fitted into memory at a time; more need not be tried again.
        work: What it took; nothing of one that was committed before.
    """

    episodes: int
    lanes: int
    work: ChunkWork = ChunkWork()


def run_chunk(
    batch: OpenBatch,
    number: int,
    simulate: Simulate,
    record: WriteRecordings | None = None,
    *,
    lanes: int,
    left_s: float,
    spent_s: float = 0.0,
    unusable: Mapping[str, Failure] | None = None,
) -> ChunkEnd:
    """Returns how a chunk ended, once its results are committed; one that was committed before is not run again.

    One that was committed and that this owner does not vouch for is run again, and compared.

    Args:
        batch: The batch.
        number: The chunk's number.
        simulate: Simulates episodes.
        record: Writes recordings, before the chunk that names them is committed; None if nothing is recorded.
        lanes: How many lanes fit into memory, as far as is known.
        left_s: Wall seconds that the batch has left.
        spent_s: Wall seconds that were spent on it before.
        unusable: Why episodes fail that need an application whose bundle cannot be used, by its digest.

    Raises:
        StageFailed: It was committed with other results, which nobody vouches for.
    """
    committed = stored_chunk(batch.store, batch.id, number, batch.authenticator)
    if committed is not None and committed.authentic:
        return ChunkEnd(batch.layout.chunk_size(number), lanes)
    start_s, start = time.monotonic(), begin_chunk(batch.store, batch.id, number, spent_s)
    chunk, able, worlds, unable = prepared_chunk(batch, number, unusable or {})
    work = _Work(batch, able, worlds, left_s, simulate, recording=record is not None)
    with collect_timings() as timings:
        found, lanes = retry_with_fewer_lanes(work.sound, after_deaths(lanes, start.attempts), work.part, work.watch)
        found = work.settled(found)
    _note_timeout(batch, work.watch, found)
    if gl := next((each.gl for each in timings if each.gl), ""):
        note_gl(batch, gl)
    if record is not None:
        found = _recorded(work, found, functools.partial(record, number))
    failed = EpisodeColumns.of([failed_result(index, failure) for index, failure in unable.items()])
    index = np.array([each.index for each in chunk.requests], np.int64)
    rows = commit(batch.store, batch.id, number, EpisodeColumns.join([failed, found]).at(index), batch.authenticator)
    _tell_failures(number, rows)
    simulated_s = sum(rows.numbers("simulated_s").tolist())
    return ChunkEnd(len(rows), lanes, work_of(timings, simulated_s=simulated_s, wall_s=time.monotonic() - start_s))


def _tell_failures(number: int, rows: EpisodeColumns) -> None:
    """Tells the log why jobs of a chunk failed, each reason once, and which may differ another time; rows hold all."""
    failed = rows.take(np.flatnonzero(rows.says("status", "Failed")))
    reasons = Counter(f"{row.failure_code}: {row.failure_reason}" for row in failed)
    for reason, count in reasons.most_common(_REASONS_TOLD):
        logger.warning("chunk %d: %d failed: %s", number, count, terminal_line(reason))
    unlocked = rows.index[(rows.numbers("late") != 0) | (rows.numbers("stray") != 0)].tolist()
    if unlocked:
        few = ", ".join(map(str, unlocked[:5]))
        logger.warning("chunk %d: lock-step did not hold in %d of %d jobs (%s)", number, len(unlocked), len(rows), few)


def _note_timeout(batch: OpenBatch, watch: StopWatch, rows: EpisodeColumns) -> None:
    """Ends a batch whose time was over before a chunk's commit: whoever goes on must not begin the rest."""
    if watch.code == "BatchTimedOut" and rows.says("status", "Canceled").any():
        time_out(batch)


class _Work:
    """The episodes of a chunk that can be simulated, simulated part by part."""

    def __init__(
        self,
        batch: OpenBatch,
        chunk: Chunk,
        worlds: Mapping[str, World],
        left_s: float,
        simulate: Simulate,
        *,
        recording: bool,
    ) -> None:
        self.sound = chunk
        self.watch = StopWatch(batch, [request.index for request in chunk.requests], left_s)
        self.recorders: list[Recorder] = []
        self._samples, self._rate_hz = sample_memory(), batch.plan.recordings.rateHz
        self._batch, self._worlds, self._simulate, self._recording = batch, worlds, simulate, recording
        recordings, layout = batch.plan.recordings, batch.layout
        every = [template.record or recordings.episodes == "all" for template in batch.plan.templates]
        always = tuple(each.index for each in chunk.requests if every[layout.template_of(each.index)])
        self._choice = RecordingChoice(always=always, failed=recordings.episodes == "failed")

    def part(self, chunk: Chunk, lanes: int) -> Results:
        """Returns the rows of a part; what it recorded is kept if it comes to its end."""
        recorder = Recorder(self._rate_hz, self._wanted, self._samples) if self._recording else None
        whole = chunk.requests == self.sound.requests
        part = ChunkPart(chunk, self._worlds, lanes, self.watch, recorder, whole, self._choice)
        rows = self._simulate(part)
        if recorder is not None:
            self.recorders.append(recorder)
        return rows

    def settled(self, rows: EpisodeColumns) -> EpisodeColumns:
        """Returns rows as they stand after what was cancelled until now."""
        self.watch.look(self._batch.record())
        ended = np.isin(rows.index, sorted(self.watch.canceled)) | rows.says("status", "Canceled")
        found = rows.take(np.flatnonzero(ended))
        return rows.renewed(EpisodeColumns.of([self.watch.settled(row) for row in found]))

    def _wanted(self, rows: EpisodeColumns) -> Bool[np.ndarray, " rows"]:
        """Returns which episodes' recordings are kept."""
        return self._choice.chosen(rows) & ~np.isin(rows.index, sorted(self.watch.canceled))


def _recorded(work: _Work, rows: EpisodeColumns, record: Callable[[Iterable[Columns]], str]) -> EpisodeColumns:
    """Returns the rows, those of recorded episodes with the name of the file that they are in.

    Writing takes a while, and what is asked meanwhile was promised too: without who is cancelled the recordings are
    written anew.
    """
    while True:
        unwanted = work.watch.canceled
        name = record(itertools.chain.from_iterable(recorder.parts(unwanted) for recorder in work.recorders))
        recorded = {index for recorder in work.recorders for index in recorder.episodes} - unwanted
        rows = work.settled(rows)
        if not recorded & work.watch.canceled:
            return rows.marked("recording", np.isin(rows.index, sorted(recorded)), name) if recorded else rows


@dataclass(frozen=True)
class ChunkRunner:
    """Simulates parts of a batch's chunks.

    Attributes:
        bundles: Unpacked folders of the batch's applications, by digest.
        engine: ``auto``, or the engine that must run them.
        rate_hz: Samples of recordings in a simulated second.
        progress: Told how many of a part's episodes are done.
        tagged: Given the tags that applications gave to their jobs, by the index of the episode, before their rows.
        coming: Returns the chunks that are going to be run next, in their order, and their worlds.
        printed: What applications printed until now, piece by piece.
    """

    bundles: Mapping[str, Path]
    engine: str
    rate_hz: float
    progress: Callable[[int], None]
    tagged: Callable[[JobTags], None] = lambda _: None
    coming: Callable[[], Sequence[PreparedChunk]] = tuple
    printed: list[str] = field(default_factory=list[str])

    def run(self, part: ChunkPart) -> EpisodeColumns:
        """Returns the rows of a part, in request order."""
        # What does not fit into memory is not driven beside more.
        fits = part.whole and len(part.chunk.requests) <= part.lanes
        coming = (part.coming or self.coming()) if fits else ()
        client = SandboxClient(
            bundles=self.bundles,
            lanes=part.lanes,
            engine=self.engine,
            should_stop=part.watch,
            progress=self.progress,
            rate_hz=self.rate_hz,
            recorder=part.recorder,
            printed=self.printed.append,
            tagged=self.tagged,
            ahead=[each.able for each in coming],
            recorded=part.recorded,
        )
        worlds = {name: world for each in coming for name, world in each.worlds.items()}
        return client.simulate(part.chunk, {**worlds, **part.worlds})


def tag_jobs(batch: OpenBatch, tags: Mapping[int, Mapping[str, str]]) -> None:
    """Adds tags to jobs, over those of the same keys; doing it again changes nothing.

    What a job cannot have, such as a 51st tag, is told to the log: an application's tags end no batch.

    Args:
        batch: The batch.
        tags: By the index of the job.
    """
    asked = entries(batch.record())
    for index, own in tags.items():
        entry = asked[batch.layout.template_of(index)]
        born = cast("dict[str, str]", entry.get("tags") or {})
        job = Reference(kind="simulation-job", path=f"{batch.id}/{index}")
        try:
            change_tags(batch.store, job, lambda made=born: made, with_tags(own, MOST_OWN_TAGS))
        except DocumentError as refused:
            logger.warning("job %s/%d: tags of its application: %s", batch.id, index, terminal_line(str(refused)))
