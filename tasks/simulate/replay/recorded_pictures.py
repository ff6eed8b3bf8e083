"""Pictures that recordings keep: taken again, a few a second, from where recorded robots were.

They follow from the poses, so nothing is kept of them while lanes run, and a batch that keeps none costs nothing. An
application that crashes over it, or a GL that is missing, leaves recordings without pictures, and the log says why.
"""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from specs.bundle_files import CameraDeclaration
from specs.data.episode import CONTROL_S, EpisodeRequest
from specs.data.world import World
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_run import batch_mounts, load_worlds
from tasks.simulate.lane.recording import Columns
from tasks.simulate.sandbox.process_pool import ask_exclusive
from tasks.simulate.sandbox.protocol import PICTURE_ARRAYS, Answer, MessageRefused, Pictures, PicturesWork
from tasks.simulate.sandbox.simulator import Simulator, SimulatorEnded

logger = logging.getLogger(__name__)
# Of an episode that lasts for hours not every sample can have a picture anyway.
_SAMPLES = 100_000
_KINDS = (("depth_png", b"\x89PNG\r\n\x1a\n"), ("color_jpeg", b"\xff\xd8\xff"))
# Which columns say by which cameras they were taken, for bags: recordings in Parquet do not keep it.
_CAMERAS = ("depth_camera", "color_camera")


class _Seen(NamedTuple):
    """What a camera saw in an episode, by the number of the sample; the camera is None for a robot without."""

    camera: CameraDeclaration | None = None
    pictures: Mapping[int, bytes] = MappingProxyType({})


def with_pictures(batch: OpenBatch, samples: Columns, bundles: Mapping[str, Path]) -> Columns:
    """Returns samples of recorded episodes with what their robots' cameras saw: columns of bytes, None at most rows.

    Beside them are ``depth_camera`` and ``color_camera``: declarations, in each row of an episode whose robot has one.

    Args:
        batch: The episodes'.
        samples: Whole episodes, each one's in the order of time.
        bundles: Unpacked folders of the batch's applications, by digest.
    """
    names = [name for name, _ in _KINDS]
    kept = {name: np.full(len(samples["index"]), None, object) for name in (*names, *_CAMERAS)}
    requests = [batch.layout.request(index) for index in dict.fromkeys(samples["index"].tolist())]
    worlds, _ = load_worlds(batch, requests)
    for request in requests:
        rows = np.flatnonzero(samples["index"] == request.index)
        asked = batch_mounts(batch).resolved(request)
        own = {name: samples[name][rows] for name in ("t_s", "pose", "people_m", "boxes_m")}
        found = _episode_pictures(batch, asked, worlds, bundles, own)
        for name, camera, seen in zip(names, _CAMERAS, found, strict=True):
            kept[camera][rows] = seen.camera
            for row, picture in seen.pictures.items():
                kept[name][rows[row]] = picture
    return {**samples, **kept}


def _episode_pictures(
    batch: OpenBatch,
    request: EpisodeRequest,
    worlds: Mapping[str, World],
    bundles: Mapping[str, Path],
    samples: Columns,
) -> list[_Seen]:
    """Returns what an episode's cameras of each kind saw, by the number of the sample; nothing where nothing can be."""
    own = {digest: folder for digest, folder in bundles.items() if digest in request.bundles}
    some = np.arange(0, len(samples["t_s"]), max(1, -(-len(samples["t_s"]) // _SAMPLES)))
    some = some[np.isfinite(samples["pose"][some]).all(1)]
    steps = np.rint(samples["t_s"][some] / CONTROL_S).astype(int).tolist()
    poses: list[list[float]] = samples["pose"][some].astype(np.float32).tolist()
    people_m: list[list[list[float]]] = samples["people_m"][some].astype(np.float32).tolist()
    boxes_m: list[list[list[float]]] = samples["boxes_m"][some].astype(np.float32).tolist()

    def question(process: Simulator) -> PicturesWork:
        return PicturesWork(
            request=request,
            worlds=process.sent_worlds({request.world: worlds[request.world]}),
            bundles={digest: str(folder) for digest, folder in own.items()},
            lanes=batch.plan.lanes,
            engine=batch.plan.engine,
            steps=tuple(steps),
            poses=tuple((x_m, y_m, yaw_rad) for x_m, y_m, yaw_rad in poses),
            people_m=tuple(tuple((x_m, y_m) for x_m, y_m in each) for each in people_m),
            boxes_m=tuple(tuple((x_m, y_m) for x_m, y_m in each) for each in boxes_m),
            pictures_hz=batch.plan.recordings.picturesHz or 0.0,
        )

    try:
        answer, arrays = ask_exclusive(own, question)
        answer, found = answered(answer, arrays, steps)
    except (SimulatorEnded, MessageRefused) as exc:
        logger.warning("job %s/%d: no pictures: %s", batch.id, request.index, exc)
        return [_Seen(), _Seen()]
    if answer.why:
        logger.warning("job %s/%d: no pictures in colour: %s", batch.id, request.index, answer.why)
    row_of = dict(zip(steps, some.tolist(), strict=True))
    kept = [{row_of[step]: picture for step, picture in pictures.items()} for pictures in found]
    return [_Seen(camera, pictures) for camera, pictures in zip((answer.depth, answer.color), kept, strict=True)]


def answered(
    answer: Answer, arrays: Sequence[np.ndarray], steps: Sequence[int]
) -> tuple[Pictures, list[dict[int, bytes]]]:
    """Returns an answer, and each camera's pictures by the control step at which they were taken.

    Args:
        answer: Of a process that has run strangers' code.
        arrays: What goes with it.
        steps: Those that were asked for.

    Raises:
        MessageRefused: It is no answer to that.
    """
    if not isinstance(answer, Pictures):
        raise MessageRefused(f"{answer.kind}: {getattr(answer, 'reason', '')}")
    first, second = arrays[:PICTURE_ARRAYS], arrays[PICTURE_ARRAYS:]
    return answer, [_unpacked(each, steps, magic) for each, (_, magic) in zip((first, second), _KINDS, strict=True)]


def _unpacked(arrays: Sequence[np.ndarray], steps: Sequence[int], magic: bytes) -> dict[int, bytes]:
    """Returns one camera's pictures, the bytes of which begin with ``magic``; else as ``answered``."""
    if len(arrays) != PICTURE_ARRAYS or any(each.ndim != 1 or each.dtype.kind not in "iu" for each in arrays):
        raise MessageRefused("it answered with arrays that hold no pictures")
    at, lengths, body = arrays[0], arrays[1], arrays[2].astype(np.uint8).tobytes()
    ends = np.cumsum(lengths)
    sound = len(at) == len(lengths) and (lengths > 0).all() and len(np.unique(at)) == len(at)
    if not sound or (ends[-1] if len(ends) else 0) != len(body) or not np.isin(at, steps).all():
        raise MessageRefused("it answered with pictures of other steps, or of other lengths")
    pictures = [body[end - length : end] for end, length in zip(ends.tolist(), lengths.tolist(), strict=True)]
    if not all(each.startswith(magic) for each in pictures):
        raise MessageRefused("it answered with what is no picture")
    return dict(zip(at.tolist(), pictures, strict=True))
