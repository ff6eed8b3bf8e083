"""What `simyard.replay` returns."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flows.batch.replay_episode import JobReplay
from simyard.answer.html import Html, badge, block, heading, paragraph, picture, table, text
from tasks.results.playback.deviations import ColumnDeviation

_WIDTH = 760


@dataclass(frozen=True, eq=False, repr=False)
class Replay:
    """An episode that was simulated once more.

    Attributes:
        episode: What came of it: the world, how it ended, each column beside the recorded one, what the robot did.
    """

    episode: JobReplay

    @property
    def same(self) -> bool:
        """Whether nothing deviates from what was recorded, not in the last bit."""
        return self.episode.same

    @property
    def ending(self) -> str:
        """How it ended, in a word or two."""
        return self.episode.ending

    @property
    def deviations(self) -> tuple[ColumnDeviation, ...]:
        """The columns that deviate, each beside the recorded one."""
        return tuple(each for each in self.episode.deviations if not each.same)

    def save(
        self, folder: str | os.PathLike[str], *, mcap: bool | None = None, video: bool = False, bags: Sequence[str] = ()
    ) -> list[Path]:
        """Writes what `simyard replay` writes into a folder, and returns the files; none if it could not start.

        Args:
            folder: Made if it is not there.
            mcap: Whether to write `replay.mcap` for Foxglove; None means if `simyard[mcap]` is installed.
            video: Whether to write `replay.mp4`.
            bags: What to write for ROS's tools: `rosbag`, `mcap-ros1`, `rosbag2`.

        Raises:
            DocumentError: There is no such format, or what writes it is not installed.
        """
        from flows.batch.replay_files import wanted_files, write_files  # noqa: PLC0415 - only where it is written

        return write_files(self.episode, Path(folder), wanted_files(mcap=mcap, video=video, bags=bags))

    def __repr__(self) -> str:
        """Returns its job, how it ended, and whether it is the same."""
        return f"<Replay {self.episode.job}: {self.ending}, {self._answer()}>"

    def _repr_svg_(self) -> str | None:
        """Returns the episode as an animated drawing; None for one that could not start."""
        from tasks.export.drawing.floor_plan import floor_plan_svg  # noqa: PLC0415 - only where it is drawn
        from tasks.results.playback.replay_svg import replay_svg  # noqa: PLC0415 - same

        played, world = self.episode.playback, self.episode.world
        return None if played is None else replay_svg(floor_plan_svg(world), played, world.footprint)

    def _repr_html_(self) -> str:
        drawing = self._repr_svg_()
        alt = f"The episode {self.episode.job}, played on the floor plan of its world"
        shown = picture(drawing, alt, _WIDTH) if drawing else paragraph("it could not start: there is nothing to see")
        answer = badge("the same" if self.same else "deviates")
        return block(heading(self.episode.job, text(self.ending), answer), self._deviations(), paragraph(shown))

    def _answer(self) -> str:
        apart = len(self.deviations)
        return f"{apart} of {len(self.episode.deviations)} columns deviate" if apart else "the same to the last bit"

    def _deviations(self) -> Html:
        if self.same:
            return Html()
        rows = ((each.column, each.unit, each.recorded, each.replayed) for each in self.deviations)
        found = table(("column", "unit", "recorded", "replayed"), rows, len(self.deviations))
        return Html(found + "".join(paragraph(f"may be why: {cause}") for cause in self.episode.causes))
