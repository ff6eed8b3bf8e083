"""Simulates the parts of a batch's chunks, in a process that has neither keys nor a way to the store.

What their applications ask for besides, tags of their jobs, is done here.
"""

import functools
import logging
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from specs.arn import Reference
from specs.data.episode import Failure
from specs.data.episode_columns import EpisodeColumns
from specs.data.outcome_tags import MOST_OWN_TAGS
from specs.errors import DocumentError, SimyardError
from specs.terminal_text import terminal_line
from tasks.simulate.batch.commit import ChunkPart, PreparedChunk, prepared_chunk
from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.chunk.job_tags import JobTags
from tasks.simulate.plan.request import entries
from tasks.simulate.process.lanes import ConfinedLanes
from tasks.storage.tags import change_tags, with_tags

logger = logging.getLogger(__name__)
# Deliveries rest for half of a chunk's time: with one chunk ahead lanes would still rest, a third would find none.
_AHEAD = 2


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
        coming = self.coming() if part.whole and len(part.chunk.requests) <= part.lanes else ()
        lanes = ConfinedLanes(
            bundles=self.bundles,
            lanes=part.lanes,
            engine=self.engine,
            should_stop=part.watch,
            progress=self.progress,
            rate_hz=self.rate_hz,
            recorder=part.recorder,
            timed_as=part.program,
            printed=self.printed.append,
            tagged=self.tagged,
            ahead=[each.able for each in coming],
            recorded=part.recorded,
        )
        worlds = {name: world for each in coming for name, world in each.worlds.items()}
        return lanes.simulate(part.chunk, {**worlds, **part.worlds})


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
