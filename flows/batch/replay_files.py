"""The files that `simyard replay` writes: a drawing, and MCAP, a film or ROS's formats if asked for."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from flows.batch.replay_episode import JobReplay
from specs.base import Fault
from specs.data.bag_format import BAG_ENDINGS, BagFormat
from specs.data.world import World
from specs.errors import DocumentError
from tasks.export.drawing.floor_plan import floor_plan_svg
from tasks.export.picture.film import FilmScene, open_film
from tasks.results.playback.playback import Playback
from tasks.results.playback.replay_formats import is_installed, require_extra
from tasks.results.playback.replay_svg import replay_svg
from tasks.ros.bag.message_log import with_other_topics
from tasks.simulate.replay.robot_view import robot_view

# From above there is a picture a control step. With a GL in software one takes a twentieth of a second.
_FROM_ABOVE_HZ, _STEPS_A_PICTURE = 20, 2
_SIZE = (960, 720)

_BAG_FORMATS: Mapping[str, BagFormat] = {each: each for each in BAG_ENDINGS}


class Wanted(NamedTuple):
    """Which files to write besides the drawing."""

    mcap: bool
    video: bool
    bags: tuple[BagFormat, ...] = ()


def wanted_files(*, mcap: bool | None, video: bool, bags: Sequence[str] = ()) -> Wanted:
    """Returns which files to write.

    Args:
        mcap: None means if it can be.
        video: Whether a film is asked for.
        bags: ROS's formats that are asked for.

    Raises:
        DocumentError: There is no such format, or what writes one of them is not installed.
    """
    if mcap:
        require_extra("mcap", "--mcap")
    if video:
        require_extra("video", "--video")
    formats: tuple[BagFormat, ...] = tuple(_bag_format(each) for each in dict.fromkeys(bags))
    if formats:
        require_extra("ros", "--bag", formats[0])
    return Wanted(is_installed("mcap") if mcap is None else mcap, video, formats)


def _bag_format(text: str) -> BagFormat:
    found = _BAG_FORMATS.get(text)
    if found is None:
        fault = Fault(path="--bag", value=repr(text), allowed=f"one of {', '.join(BAG_ENDINGS)}")
        raise DocumentError([fault], source="simyard")
    return found


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
    if wanted.bags:
        from tasks.results.playback.ros_log import RosView, playback_log  # noqa: PLC0415 - an extra
        from tasks.ros.bag.bag_file import write_bags  # noqa: PLC0415

        log = playback_log(RosView(again.world, *robot_view(again.robot)), again.playback)
        log = with_other_topics(again.traffic, log) if again.traffic else log
        written += write_bags(folder, "replay", log, wanted.bags)
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
