"""Takes pictures again that a robot's cameras took in an episode, from where the robot was; and packs them.

A depth is a whole number of millimetres, in a PNG of 16 bits a pixel; colours are a JPEG. The same bytes come of the
same poses, with the same Pillow and, of colours, the same GL.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int, UInt8

from specs.bundle_files import ColorCameraDeclaration
from specs.data.episode import CONTROL_S, control_stride
from specs.data.world import World
from tasks.render.gl_process import DrawingFailed
from tasks.ros.message.camera_messages import depth_png, jpeg_bytes
from tasks.simulate.chunk.chunk_placement import place_chunk
from tasks.simulate.engines.program import Program
from tasks.simulate.host.color_cameras import LanePictures
from tasks.simulate.host.controllers import HostStart
from tasks.simulate.lane.lane_boxes import boxes_seen
from tasks.simulate.lane.staging import Lane
from tasks.simulate.lane.walkers import people_cylinders
from tasks.simulate.plan.chunks import split_environment
from tasks.simulate.sandbox.protocol import FILM_BYTES, Pictures, PicturesWork
from tasks.simulate.sensors.depth_camera import pictures_again as depths_again
from tasks.simulate.sensors.sensor import seed_words
from tasks.simulate.sensors.sensor_table import read_color_camera

# Taken at once: one program for any number of pictures.
_TOGETHER = 16
Steps = Int[np.ndarray, "pictures"]
Poses = Float32[np.ndarray, "pictures 3"]
Movers = Float32[np.ndarray, "pictures movers 2"]


def pictures_again(
    work: PicturesWork, worlds: Mapping[str, World], bundles: Mapping[str, Path]
) -> tuple[Pictures, list[np.ndarray]]:
    """Returns the pictures that were asked for, of the depth camera and of the colour camera.

    Args:
        work: The question.
        worlds: At least the episode's.
        bundles: Unpacked folders of its applications, by digest.

    Raises:
        BundleCrash: The applications do not import, or the engine refuses the robot.
    """
    placed = place_chunk([work.request], worlds, bundles, lanes=work.lanes, engine=work.engine)
    lanes = [lane for part in placed.parts for lane in part]
    if not lanes:
        return Pictures(), [*_packed([], []), *_packed([], [])]
    steps, poses = np.array(work.steps, np.int32), np.array(work.poses, np.float32).reshape(-1, 3)
    people_m = np.array(work.people_m, np.float32).reshape(len(steps), len(next(iter(work.people_m), ())), 2)
    boxes_m = np.array(work.boxes_m, np.float32).reshape(len(steps), len(next(iter(work.boxes_m), ())), 2)
    depth = _depths(lanes[0], (steps, poses, people_m, boxes_m), work.pictures_hz)
    camera, color, why = _colors(lanes[0], placed.program, worlds, bundles, (steps, poses, work.pictures_hz))
    return Pictures(depth=lanes[0].camera and lanes[0].camera.declared, color=camera, why=why), [*depth, *color]


def _depths(lane: Lane, known: tuple[Steps, Poses, Movers, Movers], pictures_hz: float) -> list[np.ndarray]:
    camera, scene, (steps, poses, people_m, boxes_m) = lane.camera, lane.arrays.scene, known
    if camera is None or scene is None:
        return _packed([], [])
    taken = some_pictures(steps, camera.pace.stride, pictures_hz, 4 * math.prod(camera.shape))
    seed, packed = jnp.asarray(seed_words(lane.request.own_seed)), list[bytes]()
    hull_depth_m = None if lane.hull_depth_m is None else jnp.asarray(lane.hull_depth_m)
    for first in range(0, len(taken), _TOGETHER):
        some = taken[first : first + _TOGETHER]
        filled = np.resize(some, _TOGETHER)
        beside = jax.vmap(people_cylinders)(jnp.asarray(people_m[filled]))
        where = jnp.asarray(poses[filled]), jnp.asarray(steps[filled]), beside
        boxes = boxes_seen(lane.boxes, boxes_m[filled])
        found = depths_again(camera, scene, seed, *where, hull_depth_m=hull_depth_m, boxes=boxes)
        packed += [depth_png(each, camera.range_m) for each in np.asarray(found)[: len(some)]]
    return _packed(steps[taken], packed)


def _colors(
    lane: Lane,
    program: Program,
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    wanted: tuple[Steps, Poses, float],
) -> tuple[ColorCameraDeclaration | None, list[np.ndarray], str]:
    """Returns the colour camera, its pictures, and why there are none where nothing can be drawn."""
    numbers, texts = split_environment(lane.request.environment)
    camera = read_color_camera(program.host.declare, {**texts, **numbers}) if program.host else None
    if camera is None:
        return None, _packed([], []), ""
    steps, poses, pictures_hz = wanted
    taken = some_pictures(steps, control_stride(camera.rate_hz), pictures_hz, 3 * math.prod(camera.shape))
    start = HostStart([lane], 1, program.actuators, program.applications.sensors, worlds)
    eyes = LanePictures([camera], start, bundles[lane.request.robot.digest] / "robot.xml")
    try:
        drawn: Sequence[UInt8[np.ndarray, "rows columns 3"]] = (
            list(eyes.drawn_again(steps[taken], poses[taken])) if len(taken) else []
        )
    except DrawingFailed as exc:
        return camera, _packed([], []), " ".join(str(exc).split())
    return camera, _packed(steps[taken], [jpeg_bytes(each) for each in drawn]), ""


def some_pictures(steps: Steps, stride: int, pictures_hz: float, picture_bytes: int) -> Int[np.ndarray, "pictures"]:
    """Returns which of some control steps to keep pictures of: at most so many a second, and the last that was taken.

    Together they take no great size before they are packed.

    Args:
        steps: Control steps of which it is known where the robot was, in their order.
        stride: From one picture that the camera took to the next.
        pictures_hz: Pictures in a simulated second.
        picture_bytes: Of one picture.
    """
    possible = np.flatnonzero(steps % stride == 0)
    most = max(1, FILM_BYTES // picture_bytes - 1)
    length = int(steps[-1]) + 1 if len(steps) else 0
    apart = max(-(-round(1.0 / CONTROL_S) // pictures_hz), -(-length // most))
    chosen: list[int] = []
    due = 0
    for place in possible.tolist():
        if steps[place] >= due:
            chosen.append(place)
            due = int(steps[place]) + apart
    if chosen and chosen[-1] != possible[-1]:
        chosen.append(int(possible[-1]))
    return np.array(chosen, np.intp)


def _packed(steps: Steps | Sequence[int], pictures: Sequence[bytes]) -> list[np.ndarray]:
    """Returns pictures as ``PICTURE_ARRAYS`` arrays."""
    lengths = np.array([len(each) for each in pictures], np.int64)
    return [np.asarray(steps, np.int32), lengths, np.frombuffer(b"".join(pictures), np.uint8)]
