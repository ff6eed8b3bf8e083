"""The files that `simyard replay` writes: a drawing, and MCAP or a film if asked for."""

from pathlib import Path
from typing import NamedTuple

from flows.batch.replay_episode import JobReplay
from specs.data.world import World
from tasks.export.drawing.floor_plan import floor_plan_svg
from tasks.export.picture.film import FilmScene, open_film
from tasks.results.playback.playback import Playback
from tasks.results.playback.replay_formats import is_installed, require_extra
from tasks.results.playback.replay_svg import replay_svg

# From above there is a picture a control step. With a GL in software one takes a twentieth of a second.
_FROM_ABOVE_HZ, _STEPS_A_PICTURE = 20, 2
_SIZE = (960, 720)


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


def write_files(again: JobReplay, folder: Path, wanted: Wanted) -> list[Path]:
    """Returns the files, written; none of an episode that could not start."""
    if again.playback is None:
        return []
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / "replay.svg"]
    drawing = replay_svg(floor_plan_svg(again.world), again.playback, again.world.footprint)
    written[0].write_text(drawing, encoding="utf-8")
    if wanted.mcap:
        from tasks.results.playback.replay_mcap import write_mcap  # noqa: PLC0415 - an extra

        written.append(folder / "replay.mcap")
        write_mcap(written[-1], again.world, again.playback)
    if wanted.video:
        written.append(folder / "replay.mp4")
        _write_film(written[-1], again.world, again.playback)
    return written


def _write_film(path: Path, world: World, playback: Playback) -> None:
    """Writes the film: in three dimensions where a GL is there, else from above."""
    from tasks.results.playback.replay_video import frames, with_caption, write_video  # noqa: PLC0415 - an extra

    low_m, high_m = playback.heights_m
    scene = FilmScene(world=world, radius_m=playback.radius_m, low_m=low_m, high_m=high_m)
    with open_film(scene, *_SIZE) as shoot:
        if shoot is None:
            write_video(path, frames(world, playback), _FROM_ABOVE_HZ)
            return
        shown = playback.every(_STEPS_A_PICTURE).tolist()
        pictures = (with_caption(shoot(*playback.pose[each].tolist()), playback, each) for each in shown)
        write_video(path, pictures, _FROM_ABOVE_HZ // _STEPS_A_PICTURE)
