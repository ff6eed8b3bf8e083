"""Drives one episode again, and keeps what a picture of it needs besides its row."""

import functools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol, TypedDict, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, UInt8

from specs.bundle_files import ColorCameraDeclaration
from specs.data.episode import CONTROL_S, EpisodeRequest, control_stride, failed_result
from specs.data.episode_columns import EpisodeColumns
from specs.data.world import World
from tasks.ros.bag.message_log import MessageLog
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.chunk.chunk_simulation import ReadyChunk, ready_chunk, run_ready
from tasks.simulate.host.controllers import HostControllers, SeesWorlds, drawn_by
from tasks.simulate.lane.lane_boxes import boxes_seen
from tasks.simulate.lane.recording import Columns, Ends, Recorder, Rows, Steps, Wanted
from tasks.simulate.lane.shared_world import RobotsInputs, robot_cylinders
from tasks.simulate.lane.staging import Lane
from tasks.simulate.lane.walkers import people_cylinders
from tasks.simulate.replay.replay_result import ReplayResult, Setting
from tasks.simulate.sandbox.protocol import FILM_BYTES
from tasks.simulate.sensors.depth_camera import pictures_again
from tasks.simulate.sensors.lidar import ray_angles
from tasks.simulate.sensors.sensor import seed_words

_EVERY_STEP_HZ = 1.0 / CONTROL_S
# Of a camera's pictures, a person sees so many a second.
_PICTURES_HZ = 5.0


@runtime_checkable
class _Talks(Protocol):
    """Controllers whose nodes send messages."""

    def keep_traffic(self) -> None: ...

    @property
    def traffic(self) -> MessageLog | None: ...


class _AlsoAt(Recorder):
    """A recorder that tells another one, with a rate of its own, all that it is told."""

    def __init__(self, rate_hz: float, wanted: Wanted, other: Recorder) -> None:
        super().__init__(rate_hz, wanted)
        self._other = other

    def begin(self, lanes: int, control_s: float) -> None:
        super().begin(lanes, control_s)
        self._other.begin(lanes, control_s)

    def keep(self, slice_: Steps, steps: Int[np.ndarray, "lanes"]) -> None:
        super().keep(slice_, steps)
        self._other.keep(slice_, steps)

    def end(self, ends: Ends, rows: Rows) -> None:
        super().end(ends, rows)
        self._other.end(ends, rows)


def drive_replay(
    request: EpisodeRequest,
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    *,
    lanes: int,
    engine: str,
    rate_hz: float,
    beside: Sequence[EpisodeRequest] = (),
) -> ReplayResult:
    """Returns an episode driven to its end, by itself in a program of its batch's layout.

    Args:
        request: The episode.
        worlds: At least its own.
        bundles: Unpacked folders of its applications, by digest.
        lanes: Of the batch's chunks.
        engine: What drove it.
        rate_hz: Of the batch's recordings.
        beside: The other robots that share its world.
    """
    together = sorted((request, *beside), key=lambda each: each.number)
    try:
        ready = ready_chunk(together, worlds, bundles, lanes=lanes, engine=engine)
    except BundleCrash as crash:
        return ReplayResult(failed_result(request.index, crash.failure))
    host = ready.run.host if ready.run else None
    if isinstance(host, _Talks):
        host.keep_traffic()

    def wanted(rows: EpisodeColumns) -> Bool[np.ndarray, " rows"]:
        return rows.index == request.index

    samples = Recorder(rate_hz, wanted)
    steps = _AlsoAt(_EVERY_STEP_HZ, wanted, samples)
    rows = run_ready(ready, lambda: False, lambda _: None, steps)
    (row,) = (each for each in rows if each.index == request.index)
    if not ready.lanes:
        return ReplayResult(row)
    traffic = host.traffic if isinstance(host, _Talks) else None
    each_step = _only(steps)
    setting = _setting(ready, ready.lanes[request.number], each_step, host)
    return ReplayResult(row, setting, each_step, _only(samples), traffic, drawn_by(host))


def _only(recorder: Recorder) -> Columns:
    (part,) = recorder.parts()
    return part


def _setting(ready: ReadyChunk, lane: Lane, steps: Columns, host: HostControllers | None) -> Setting:
    poses = np.asarray(steps["pose"], np.float32)
    lidar, hull = lane.lidar, ready.program.hull
    return Setting(
        goals_m=lane.placement.goals_m,
        arrived_m=lane.placement.arrived_m,
        radius_m=hull.radius_m,
        heights_m=(hull.low_m, hull.high_m),
        mount=(float(lidar.x_m), float(lidar.y_m), float(lidar.yaw_rad)),
        lidar_height_m=lidar.height_m,
        range_m=lidar.range_m,
        angles_rad=ray_angles(lidar),
        camera=lane.camera and lane.camera.declared,
        **_pictures(
            lane, poses, *(np.asarray(steps[name], np.float32) for name in ("people_m", "robots_m", "boxes_m"))
        ),
        **_colors(host, poses),
    )


class _Pictures(TypedDict):
    """Of a setting."""

    pictured_s: Float64[np.ndarray, "pictures"]
    pictures_m: Float32[np.ndarray, "pictures rows columns"]


def _pictures(
    lane: Lane,
    poses: Float32[np.ndarray, "samples 3"],
    people_m: Float32[np.ndarray, "samples people 2"],
    robots_m: Float32[np.ndarray, "samples robots 2"],
    boxes_m: Float32[np.ndarray, "samples boxes 2"],
) -> _Pictures:
    """Returns some of an episode's pictures, taken again from where the robot was: a few a second, of no great size."""
    camera = lane.camera
    if camera is None or lane.arrays.scene is None:
        return _Pictures(pictured_s=np.zeros(0), pictures_m=np.zeros((0, 0, 0), np.float32))
    taken = _some_steps(len(poses), camera.pace.stride, 4 * math.prod(camera.shape))
    seed = jnp.asarray(seed_words(lane.request.own_seed))
    hull_depth_m = None if lane.hull_depth_m is None else jnp.asarray(lane.hull_depth_m)
    beside = jax.vmap(people_cylinders)(jnp.asarray(people_m[taken]))
    if lane.robots is not None:
        others: RobotsInputs = jax.tree.map(jnp.asarray, lane.robots)
        robots = jax.vmap(functools.partial(robot_cylinders, others))(jnp.asarray(robots_m[taken]))
        beside = jnp.concatenate([beside, robots], axis=1)
    where = jnp.asarray(poses[taken]), jnp.asarray(taken), beside
    boxes = boxes_seen(lane.boxes, boxes_m[taken])
    found = pictures_again(camera, lane.arrays.scene, seed, *where, hull_depth_m=hull_depth_m, boxes=boxes)
    return _Pictures(pictured_s=taken * CONTROL_S, pictures_m=np.asarray(found))


class _Colors(TypedDict):
    """Of a setting."""

    color_camera: ColorCameraDeclaration | None
    colored_s: Float64[np.ndarray, "colors"]
    colors: UInt8[np.ndarray, "colors rows columns 3"]


def _colors(host: HostControllers | None, poses: Float32[np.ndarray, "samples 3"]) -> _Colors:
    """Returns the same of the colour camera; nothing where nothing was drawn for it."""
    camera = host.first_camera() if isinstance(host, SeesWorlds) else None
    if camera is None or not isinstance(host, SeesWorlds):
        return _Colors(color_camera=None, colored_s=np.zeros(0), colors=np.zeros((0, 0, 0, 3), np.uint8))
    taken = _some_steps(len(poses), control_stride(camera.rate_hz), 3 * math.prod(camera.shape))
    return _Colors(color_camera=camera, colored_s=taken * CONTROL_S, colors=host.drawn_again(taken, poses[taken]))


def _some_steps(samples: int, stride: int, picture_bytes: int) -> Int[np.ndarray, "pictures"]:
    """Returns control steps at which a camera took pictures: a few a second, that take no great size together."""
    most = max(1, FILM_BYTES // picture_bytes)
    apart = max(-(-round(_EVERY_STEP_HZ / _PICTURES_HZ) // stride), -(-samples // (most * stride)))
    return np.arange(0, samples, apart * stride, dtype=np.int32)
