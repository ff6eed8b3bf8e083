"""Simulates the parts of a batch's chunks, in a process that has neither keys nor a way to the store."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from specs.data.episode import EpisodeResult
from tasks.simulate.batch.commit import ChunkPart
from tasks.simulate.process.lanes import ConfinedLanes


@dataclass(frozen=True)
class ChunkRunner:
    """Simulates parts of a batch's chunks.

    Attributes:
        bundles: Unpacked folders of the batch's applications, by digest.
        engine: ``auto``, or the engine that must run them.
        rate_hz: Samples of recordings in a simulated second.
        progress: Told how many of a part's episodes are done.
        printed: What applications printed until now, piece by piece.
    """

    bundles: Mapping[str, Path]
    engine: str
    rate_hz: float
    progress: Callable[[int], None]
    printed: list[str] = field(default_factory=list[str])

    def run(self, part: ChunkPart) -> list[EpisodeResult]:
        """Returns the rows of a part, in request order."""
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
        )
        return lanes.simulate(part.chunk, part.worlds)
