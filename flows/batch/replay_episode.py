"""`simyard replay`: an episode simulated once more, compared with what was recorded of it, drawn, and written to files.

The files are a drawing, and MCAP, a film or ROS's formats if asked for.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
import pyarrow as pa

from specs.data.boxes import Box
from specs.data.episode import reason
from specs.data.world import World
from specs.errors import DocumentError
from specs.field_types import BAG_ENDINGS, BagFormat, OutputLocation
from tasks.applications.registry import unpack
from tasks.export.drawing.floor_plan import floor_plan_svg
from tasks.results.playback.plan_drawings import replay_svg
from tasks.results.playback.playback import (
    BoxFilm,
    CameraFilm,
    ColumnDeviation,
    Playback,
    Sight,
    recording_deviations,
    row_deviations,
)
from tasks.results.playback.replay_formats import is_installed, require_extra
from tasks.results.tables.recordings import DEPTH_PNG, recording_table
from tasks.results.tables.result_files import FAILURES_FILE, RESULTS_FILE, changed_tables, recorded_samples, stored_rows
from tasks.ros.bag.message_log import MessageLog, with_other_topics
from tasks.simulate.batch.batch_record import OpenBatch, job_of
from tasks.simulate.batch.provenance import another_gl, batch_metadata, recorded_machines, this_machine
from tasks.simulate.geometry.obstacles import PARKING_M
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.simulate.replay.recorded_pictures import with_pictures
from tasks.simulate.replay.replay_run import Replay, replay
from tasks.storage.base.local_files import cache_folder
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.storage.resource_names import find_resource


class JobReplay(NamedTuple):
    """An episode simulated once more.

    Attributes:
        job: ``<batch>/<index>``.
        world: Where it took place.
        ending: How it ended, in a word or two.
        deviations: Each column that was recorded, beside the replay's.
        causes: What is not as it was when it was recorded, and may have changed a number.
        playback: What the robot did; None for an episode that could not start.
        robot: Folder of the robot's bundle on this machine.
        traffic: What its robot and its ROS nodes said to each other; None where there were none.
    """

    job: str
    world: World
    ending: str
    deviations: tuple[ColumnDeviation, ...]
    causes: tuple[str, ...]
    playback: Playback | None
    robot: Path
    traffic: MessageLog | None

    @property
    def same(self) -> bool:
        """Returns whether nothing deviates, not in the last bit."""
        return all(each.same for each in self.deviations)


def replay_job(store: Store, text: str) -> JobReplay:
    """Returns a simulation job, by its ARN or ``<batch>/<index>``, simulated once more.

    Raises:
        ResourceNotFound: There is no such job, or what it needs is gone.
        DocumentError: The text names no job, or one that has not come to an end of its own.
    """
    batch, index = job_of(store, find_resource(store, text, ("simulation-job",)).path)
    record = batch.record()
    location = recorded_location(record)
    recorded = _recorded_row(batch, record, location, index)
    folders = bundles(batch)
    again = replay(batch, index, folders, engine=str(recorded.column("engine")[0]))
    return JobReplay(
        job=f"{batch.id}/{index}",
        world=again.world,
        ending=reason(again.driven.row) or again.driven.row.outcome,
        deviations=(
            *row_deviations(recorded, batch.id, again.request, again.driven.row),
            *_in_recording(batch, location, recorded, again, folders),
        ),
        causes=(*_tables_changed(batch, record, location), *_causes(record, recorded, again)),
        playback=playback(batch.id, again, folders[again.request.robot.digest]),
        robot=folders[again.request.robot.digest],
        traffic=again.driven.traffic,
    )


def bundles(batch: OpenBatch) -> dict[str, Path]:
    """Returns the folders of a batch's applications on this machine, by digest."""
    return unpacked(batch.store, batch.plan.digests())


def unpacked(store: Store, digests: Iterable[str]) -> dict[str, Path]:
    """Returns the folders of some bundles on this machine, by digest."""
    return {digest: unpack(store, digest, cache_folder() / "bundles") for digest in digests}


def playback(batch_id: str, again: Replay, robot: Path) -> Playback | None:
    """Returns what the robot did in a replay; None for an episode that could not start.

    Args:
        batch_id: The batch.
        again: The replay.
        robot: The folder of the robot's bundle.
    """
    from tasks.simulate.geometry.hull_outline import robot_shape  # noqa: PLC0415 - it loads MuJoCo

    row, setting, steps = again.driven.row, again.driven.setting, again.driven.steps
    if setting is None or steps is None:
        return None
    return Playback(
        job=f"{batch_id}/{row.index}",
        ending=reason(row) or row.outcome,
        goals_m=setting.goals_m,
        arrived_m=setting.arrived_m,
        radius_m=setting.radius_m,
        heights_m=setting.heights_m,
        sight=Sight(setting.mount, setting.lidar_height_m, setting.range_m, setting.angles_rad),
        t_s=steps["t_s"],
        pose=steps["pose"],
        velocity=steps["velocity"],
        goal_index=steps["goal_index"],
        acted=np.asarray(steps["acted"], bool),
        control=steps["control"],
        ranges_m=steps["ranges_m"],
        impulse_ns=steps["impulse_ns"],
        people_m=_walking(np.asarray(steps["people_m"])),
        robots_m=np.asarray(steps["robots_m"]),
        boxes=_put(again.request.boxes, np.asarray(steps["boxes_m"])),
        shape=robot_shape(robot / "robot.xml"),
        depth=CameraFilm(setting.camera, setting.pictured_s, setting.pictures_m) if setting.camera else None,
        color=CameraFilm(setting.color_camera, setting.colored_s, setting.colors) if setting.color_camera else None,
    )


def _walking(people_m: np.ndarray) -> np.ndarray:
    """Returns the people who are there of those that a program has room for: the others are far away."""
    return people_m[:, np.abs(people_m[0, :, 0]) < PARKING_M]


def _put(boxes: tuple[Box, ...] | None, places_m: np.ndarray) -> BoxFilm | None:
    """Returns the boxes of an episode, of those that a program has room for; one that is not there is far away."""
    if boxes is None:
        return None
    own_m = places_m[:, : len(boxes)]
    return BoxFilm(tuple(box.size_m for box in boxes), own_m, own_m[:, :, 1] < PARKING_M)


def _recorded_row(batch: OpenBatch, record: JobRecord, location: OutputLocation, index: int) -> pa.Table:
    if "results_url" not in record.detail:
        raise _refused(batch, index, f"a job of a batch that has its tables; this one is {record.status}")
    row = stored_rows(batch.store, location, batch.id, RESULTS_FILE, index=index)
    passed = row.column("success").to_pylist()[0]
    if passed is None:
        raise _refused(
            batch, index, "a job that came to its end; this one was canceled, so there is nothing to compare"
        )
    return row if passed else stored_rows(batch.store, location, batch.id, FAILURES_FILE, index=index)


def _in_recording(
    batch: OpenBatch, location: OutputLocation, recorded: pa.Table, again: Replay, bundles: Mapping[str, Path]
) -> list[ColumnDeviation]:
    name = str(recorded.column("recording")[0])
    if not name:
        return []
    before = recorded_samples(batch.store, location, batch.id, name, again.request.index)
    samples = again.driven.samples
    if samples is None:
        return recording_deviations(before, before.slice(0, 0))
    pictures = DEPTH_PNG in before.column_names
    return recording_deviations(
        before, recording_table(with_pictures(batch, samples, bundles) if pictures else samples)
    )


def _tables_changed(batch: OpenBatch, record: JobRecord, location: OutputLocation) -> list[str]:
    """Returns which of the batch's tables were changed since it wrote them: the row may be what somebody made of it."""
    sha256s = cast("Mapping[str, str]", record.detail.get("sha256s", {}))
    return changed_tables(batch.store, location, batch.id, sha256s, (RESULTS_FILE, FAILURES_FILE))


def _causes(record: JobRecord, recorded: pa.Table, again: Replay) -> Iterator[str]:
    """Yields what is not as it was, from the batch's record, its row, and what is here."""
    before = cast("Mapping[str, str]", record.detail.get("metadata", {}))
    now = batch_metadata(int(before.get("lanes", 0)))
    for package in now:
        if package != "lanes" and before.get(package, now[package]) != now[package]:
            yield f"{package} was {before[package]}, and is {now[package]}"
    for name in ("engine", "device"):
        was, is_now = str(recorded.column(name)[0]), str(getattr(again.driven.row, name))
        if was != is_now:
            yield f"the {name} was {was or 'none'}, and is {is_now or 'none'}"
    if other := another_gl(record, again.driven.gl):
        yield other
    names, here = recorded_machines(record), this_machine()
    if names and here not in names:
        yield f"it ran on {' and '.join(names)}, and this is {here}"


def _refused(batch: OpenBatch, index: int, allowed: str) -> DocumentError:
    return DocumentError.of("simulation-job", f"{batch.id}/{index}", allowed, source="simyard")


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
        raise DocumentError.of("--bag", repr(text), f"one of {', '.join(BAG_ENDINGS)}", source="simyard")
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
        from tasks.simulate.host.twist_drive import robot_view  # noqa: PLC0415 - it loads MuJoCo

        log = playback_log(RosView(again.world, *robot_view(again.robot)), again.playback)
        log = with_other_topics(again.traffic, log) if again.traffic else log
        written += write_bags(folder, "replay", log, wanted.bags)
    return written


def _write_film(path: Path, world: World, playback: Playback) -> None:
    """Writes the film: in three dimensions where a GL is there, else from above."""
    from tasks.export.picture.renderer import FilmScene, open_film  # noqa: PLC0415 - it loads MuJoCo
    from tasks.results.playback.replay_video import frames, with_captions, write_video  # noqa: PLC0415 - an extra

    low_m, high_m = playback.heights_m
    movers = [playback.people_m, playback.robots_m, *([] if playback.boxes is None else [playback.boxes.places_m])]
    movers_m = np.concatenate(movers, axis=1).astype(np.float64)
    scene = FilmScene(
        world=world,
        radius_m=playback.radius_m,
        low_m=low_m,
        high_m=high_m,
        shape=playback.shape,
        people=playback.people_m.shape[1],
        robots=playback.robots_m.shape[1],
        boxes=() if playback.boxes is None else playback.boxes.sizes_m,
    )
    with open_film(scene, *_SIZE) as shoot:
        if shoot is None:
            write_video(path, frames(world, playback), _FROM_ABOVE_HZ)
            return
        shown = playback.every(_STEPS_A_PICTURE).tolist()
        shot = (shoot(*playback.pose[each].tolist(), movers_m=movers_m[each].tolist()) for each in shown)
        write_video(path, with_captions(shot, playback, shown), _FROM_ABOVE_HZ // _STEPS_A_PICTURE)
