"""Simulates the parts of a batch's chunks, in a process that has neither keys nor a way to the store.

What their applications ask for besides, tags of their jobs, is done here.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from specs.arn import Reference
from specs.data.episode_columns import EpisodeColumns
from specs.data.outcome_tags import MOST_OWN_TAGS
from specs.errors import DocumentError
from specs.terminal_text import terminal_line
from tasks.simulate.batch.commit import ChunkPart
from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.batch.prepared_chunks import PreparedChunk
from tasks.simulate.chunk.job_tags import JobTags
from tasks.simulate.plan.request import entries
from tasks.simulate.process.lanes import ConfinedLanes
from tasks.storage.tags import change_tags, with_tags

logger = logging.getLogger(__name__)


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
