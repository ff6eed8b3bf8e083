"""What robots of failed episodes saw last, for the report of a batch whose recordings keep pictures.

A recording lies where others may write: what is no picture, or a large one, is left out, and the log says so.
"""

import logging
import re
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from PIL import Image

from specs.base import Spec
from specs.errors import ObjectNotFound
from specs.field_types import OutputLocation
from tasks.results.playback.robot_view import depth_shades, farthest_m, image_url, shades_png
from tasks.results.report.report_columns import FailedEpisode
from tasks.results.tables.recordings import COLOR_JPEG, DEPTH_PNG, RECORDINGS_FOLDER
from tasks.ros.message.camera_messages import jpeg_bytes
from tasks.storage.base.keys import checked_name, output_key
from tasks.storage.base.store import Store

logger = logging.getLogger(__name__)
# So that a page stays below a few megabytes, however many fail and whatever their cameras have.
_FAILURES, _PICTURES, _SIDE_PX, _MOST_PX = 36, 3, 160, 640 * 480
_FILE = re.compile(r"[0-9]{6,}\.parquet")
_COLUMNS = (DEPTH_PNG, COLOR_JPEG)


class SeenPicture(Spec):
    """What a robot saw.

    Attributes:
        url: The picture as a URL that holds it.
        label: What it shows, for a person.
        when: Simulated time.
    """

    url: str
    label: str
    when: str


LastSeen = Callable[[FailedEpisode], tuple[SeenPicture, ...]]
"""Returns what the robot of an episode saw last, the oldest first; nothing of one that left no pictures."""


def no_pictures(failure: FailedEpisode) -> tuple[SeenPicture, ...]:  # noqa: ARG001 - as `last_seen` returns them
    """Returns nothing, for a batch whose recordings keep no pictures."""
    return ()


def last_seen(bucket: Store, location: OutputLocation, batch: str, folder: Path) -> LastSeen:
    """Returns what finds pictures of a batch's failed episodes, of the first ones that it is asked for.

    Args:
        bucket: Of the batch's output.
        location: Where in it.
        batch: The batch's id.
        folder: For its files, each of which is fetched once.
    """
    asked = 0

    def seen(failure: FailedEpisode) -> tuple[SeenPicture, ...]:
        nonlocal asked
        if not failure.recording or asked >= _FAILURES:
            return ()
        asked += 1
        try:
            path = folder / _checked(failure.recording)
            if not path.exists():
                key = f"{RECORDINGS_FOLDER}/{checked_name(batch, 'batch')}/{path.name}"
                bucket.download(output_key(location.s3Prefix, key), path)
            return _pictures(path, failure.index)
        except (ObjectNotFound, OSError, ValueError, pa.ArrowException, Image.DecompressionBombError) as exc:
            logger.warning("job %s/%d: no pictures in the report: %s", batch, failure.index, exc)
            return ()

    return seen


def _checked(recording: str) -> str:
    """Returns the name of a file of recordings, if it is one.

    Raises:
        ValueError: It is not.
    """
    if not _FILE.fullmatch(recording):
        raise ValueError(f"no name of a recording: {recording!r}")
    return recording


def _pictures(path: Path, index: int) -> tuple[SeenPicture, ...]:
    columns = [name for name in _COLUMNS if name in pq.read_schema(path).names]
    if not columns:
        return ()
    rows = pq.read_table(path, columns=["t_s", *columns], filters=[("index", "=", index)])
    found: list[SeenPicture] = []
    for name in columns:
        there = rows.filter(pc.call_function("is_valid", [rows.column(name)]))
        last = there.slice(max(0, there.num_rows - _PICTURES)).to_pylist()
        arrays = [_unpacked(each[name]) for each in last]
        far_m = max((farthest_m(each / 1000.0, np.inf) for each in arrays), default=0.0)
        for each, array in zip(last, arrays, strict=True):
            found.append(_shown(array, f"{each['t_s']:.2f} s", far_m))
    return tuple(found)


def _unpacked(packed: bytes) -> np.ndarray:
    """Returns a picture with no more pixels than a page shows.

    Raises:
        ValueError: It is too large, or of another form than recordings have.
    """
    with Image.open(BytesIO(packed), formats=["PNG", "JPEG"]) as image:
        if image.width * image.height > _MOST_PX or image.mode not in {"I;16", "RGB"}:
            raise ValueError(f"a picture of {image.width} x {image.height} pixels in mode {image.mode}")
        every = -(-max(image.size) // _SIDE_PX)
        return np.asarray(image)[::every, ::every]


def _shown(pixels: np.ndarray, when: str, far_m: float) -> SeenPicture:
    """Returns a picture of depths (mm, 0 for nothing) in colours, or one in colours as it is."""
    if pixels.ndim == 3:
        return SeenPicture(url=image_url(jpeg_bytes(pixels)), label="colour", when=when)
    depth_m = np.where(pixels == 0, np.inf, pixels / 1000.0)
    url = image_url(shades_png(depth_shades(depth_m, far_m, np.inf)))
    return SeenPicture(url=url, label=f"depth, light 0 m to dark {far_m:.1f} m", when=when)
