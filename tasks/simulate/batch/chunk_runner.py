"""Simulates the parts of a batch's chunks in this process."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from specs.data.episode import EpisodeResult
from tasks.simulate.batch.commit import ChunkPart
from tasks.simulate.chunk.runner import simulate_lanes


@dataclass(frozen=True)
class ChunkRunner:
    """Simulates parts of a batch's chunks.

    Attributes:
        bundles: Unpacked folders of the batch's applications, by digest.
        engine: ``auto``, or the engine that must run them.
        progress: Told how many of a part's episodes are done.
    """

    bundles: Mapping[str, Path]
    engine: str
    progress: Callable[[int], None]

    def run(self, part: ChunkPart) -> list[EpisodeResult]:
        """Returns the rows of a part, in request order."""
        return simulate_lanes(
            part.chunk,
            part.worlds,
            self.bundles,
            lanes=part.lanes,
            engine=self.engine,
            should_stop=part.watch,
            progress=self.progress,
            recorder=part.recorder,
            timed_as=part.program,
        )
