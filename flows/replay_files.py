"""The files that `simyard replay` leaves: a drawing always, and what is asked for or can be written here."""

from pathlib import Path
from typing import NamedTuple

from flows.replaying import Replayed
from tasks.export.svg import floor_plan_svg
from tasks.results.extras import is_installed, require_extra
from tasks.results.replay_svg import replay_svg

# As many as there are control steps: the film runs in simulated time.
_FRAMES_HZ = 20


class Wanted(NamedTuple):
    """Which files to write besides the drawing."""

    mcap: bool
    video: bool


def wanted_files(*, mcap: bool | None, video: bool) -> Wanted:
    """Returns which files to write.

    Args:
        mcap: None means if it can be.
        video: Whether a film is asked for.

    Raises:
        DocumentError: What writes one of them is not installed.
    """
    if mcap:
        require_extra("mcap")
    if video:
        require_extra("video")
    return Wanted(is_installed("mcap") if mcap is None else mcap, video)


def write_files(again: Replayed, folder: Path, wanted: Wanted) -> list[Path]:
    """Returns the files, written; none of an episode that could not start."""
    if again.playback is None:
        return []
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / "replay.svg"]
    drawing = replay_svg(floor_plan_svg(again.world), again.playback, again.world.footprint)
    written[0].write_text(drawing, encoding="utf-8")
    if wanted.mcap:
        from tasks.results.replay_mcap import write_mcap  # noqa: PLC0415 - an extra

        written.append(folder / "replay.mcap")
        write_mcap(written[-1], again.world, again.playback)
    if wanted.video:
        from tasks.results.replay_frames import frames  # noqa: PLC0415 - an extra
        from tasks.results.replay_video import write_video  # noqa: PLC0415 - an extra

        written.append(folder / "replay.mp4")
        write_video(written[-1], frames(again.world, again.playback), _FRAMES_HZ)
    return written
