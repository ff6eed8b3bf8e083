"""Messages of cameras, as bytes in ROS 1's form: pictures, how they project, and the points that depths show.

They are in a camera's optical frame: z ahead, x to the right, y down (REP 103). Whole numbers of pixels are their
middles, as OpenCV and ROS have it: so the middle of a picture is half a pixel before half its width.
"""

import math
import struct
from io import BytesIO
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Shaped, UInt8, UInt16

from tasks.ros.message.ros_messages import Stamp, header, text_bytes

Depths = Float[np.ndarray, "rows columns"]
_SIZE, _COUNT, _STEP = struct.Struct("<II"), struct.Struct("<I"), struct.Struct("<BI")
_MATRICES = struct.Struct("<I5d9d9d12d")
# Binning, the region of interest and whether it is rectified: none, the whole, no.
_WHOLE = bytes(25)
_MM_A_M, _MOST_MM = 1000.0, 65_535
_FLOAT32, _POINT_BYTES = 7, 12
_JPEG_QUALITY = 80  # as the image transport of ROS
_ENCODINGS = {"uint8": "rgb8", "uint16": "16UC1", "float32": "32FC1"}


class Pinhole(NamedTuple):
    """How a camera projects: square pixels, the middle of the picture straight ahead, no distortion.

    Attributes:
        columns, rows: Of its picture.
        fov_rad: From the left edge to the right one.
    """

    columns: int
    rows: int
    fov_rad: float

    @property
    def focal_px(self) -> float:
        """Returns its focal length in pixels."""
        return self.columns / 2 / math.tan(self.fov_rad / 2)

    @property
    def middle_px(self) -> tuple[float, float]:
        """Returns the column and the row that what is straight ahead falls on."""
        return (self.columns - 1) / 2, (self.rows - 1) / 2


def image(sequence: int, time: Stamp, frame: str, pixels: Shaped[np.ndarray, "rows columns *channels"]) -> bytes:
    """Returns a ``sensor_msgs/Image``: ``rgb8`` of bytes, ``16UC1`` and ``32FC1`` of numbers of two and four bytes.

    Args:
        sequence: Of the message among those of its topic.
        time: When the picture was taken.
        frame: The camera's optical one.
        pixels: From the upper left corner.
    """
    rows, columns, encoding = *pixels.shape[:2], _ENCODINGS[pixels.dtype.name]
    data = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder("<")).tobytes()
    step = _STEP.pack(0, len(data) // rows)
    parts = (header(sequence, time, frame), _SIZE.pack(rows, columns), text_bytes(encoding), step)
    return b"".join((*parts, _COUNT.pack(len(data)), data))


def compressed_image(sequence: int, time: Stamp, frame: str, pixels: UInt8[np.ndarray, "rows columns 3"]) -> bytes:
    """Returns a ``sensor_msgs/CompressedImage``: JPEG, as ROS's image transport has it; arguments as of ``image``."""
    return packed_image(sequence, time, frame, jpeg_bytes(pixels))


def packed_image(sequence: int, time: Stamp, frame: str, jpeg: bytes) -> bytes:
    """Returns the same of a picture that is JPEG already."""
    said = text_bytes("rgb8; jpeg compressed bgr8")
    return b"".join((header(sequence, time, frame), said, _COUNT.pack(len(jpeg)), jpeg))


def jpeg_bytes(pixels: UInt8[np.ndarray, "rows columns 3"]) -> bytes:
    """Returns a picture as JPEG."""
    return _saved(pixels, "jpeg", quality=_JPEG_QUALITY)


def depth_png(depth_m: Depths, range_m: float) -> bytes:
    """Returns depths as a PNG of 16 bits a pixel, in whole millimetres as of ``depths_in_mm``."""
    return _saved(depths_in_mm(depth_m, range_m), "png")


def depths_of_png(png: bytes, columns: int, rows: int) -> UInt16[np.ndarray, "rows columns"]:
    """Returns what ``depth_png`` has packed.

    Raises:
        OSError: It is no PNG.
        ValueError: It is of another size, or in another form.
    """
    from PIL import Image  # noqa: PLC0415 - where somebody asks for such a picture

    with Image.open(BytesIO(png), formats=["PNG"]) as found:
        if found.size != (columns, rows) or found.mode != "I;16":
            raise ValueError(f"a picture of {found.width} x {found.height} pixels in mode {found.mode}")
        return np.asarray(found, np.uint16)


def jpegs_apart(jpeg: bytes, columns: int, rows: int, count: int) -> list[bytes]:
    """Returns each of some pictures that one JPEG has, one above the other, as a JPEG.

    Raises:
        OSError: It is no JPEG.
        ValueError: It is of another size.
    """
    from PIL import Image  # noqa: PLC0415 - where somebody asks for such a picture

    with Image.open(BytesIO(jpeg), formats=["JPEG"]) as found:
        if found.size != (columns, count * rows) or found.mode != "RGB":
            raise ValueError(f"a picture of {found.width} x {found.height} pixels in mode {found.mode}")
        return [jpeg_bytes(each) for each in np.split(np.asarray(found), count)]


def _saved(pixels: Shaped[np.ndarray, "rows columns *channels"], form: str, **options: int) -> bytes:
    from PIL import Image  # noqa: PLC0415 - where somebody asks for such a picture

    packed = BytesIO()
    Image.fromarray(pixels).save(packed, form, **options)
    return packed.getvalue()


def depths_in_m(depth_m: Depths, range_m: float) -> Float32[np.ndarray, "rows columns"]:
    """Returns depths as ``32FC1`` has them (REP 118): +inf where nothing is seen within the range."""
    found = np.array(depth_m, np.float32)
    found[found >= np.float32(range_m)] = np.inf
    return found


def depths_in_mm(depth_m: Depths, range_m: float) -> UInt16[np.ndarray, "rows columns"]:
    """Returns depths as ``16UC1`` has them (REP 118): 0 where nothing is seen within the range, or within 65.5 m."""
    far = np.asarray(depth_m, np.float32)
    found = np.rint(_MM_A_M * far.astype(np.float64))
    return np.where((far < np.float32(range_m)) & (found <= _MOST_MM), found, 0.0).astype(np.uint16)


def camera_info(sequence: int, time: Stamp, frame: str, camera: Pinhole) -> bytes:
    """Returns a ``sensor_msgs/CameraInfo``; other arguments as of ``image``."""
    focal, (column, row) = camera.focal_px, camera.middle_px
    turn = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    inner = (focal, 0.0, column, 0.0, focal, row, 0.0, 0.0, 1.0)
    whole = (focal, 0.0, column, 0.0, 0.0, focal, row, 0.0, 0.0, 0.0, 1.0, 0.0)
    numbers = _MATRICES.pack(5, *(0.0,) * 5, *inner, *turn, *whole)
    size = _SIZE.pack(camera.rows, camera.columns)
    return b"".join((header(sequence, time, frame), size, text_bytes("plumb_bob"), numbers, _WHOLE))


def _point_fields() -> bytes:
    named = (text_bytes(name) + struct.pack("<IBI", 4 * place, _FLOAT32, 1) for place, name in enumerate("xyz"))
    return _COUNT.pack(3) + b"".join(named)


_POINT_FIELDS = _point_fields()


def point_cloud(sequence: int, time: Stamp, frame: str, camera: Pinhole, seen_m: Depths) -> bytes:
    """Returns a ``sensor_msgs/PointCloud2`` with a point for each pixel, rows of the picture first.

    Args:
        sequence: Of the message among those of its topic.
        time: When the picture was taken.
        frame: The camera's optical one.
        camera: Whose picture it is.
        seen_m: Depths as ``depths_in_m`` returns them; where one is not finite, the point is not a number.
    """
    depth = np.where(np.isfinite(seen_m), seen_m, np.nan).astype(np.float64)
    column, row = camera.middle_px
    right = (np.arange(camera.columns) - column) / camera.focal_px
    down = (np.arange(camera.rows)[:, None] - row) / camera.focal_px
    points = np.stack([right * depth, down * depth, depth], axis=-1).astype("<f4").tobytes()
    layout = struct.pack("<BII", 0, _POINT_BYTES, _POINT_BYTES * camera.columns)
    sizes = _SIZE.pack(camera.rows, camera.columns), _POINT_FIELDS, layout, _COUNT.pack(len(points))
    return b"".join((header(sequence, time, frame), *sizes, points, b"\0"))


def optical_turn(yaw_rad: float, pitch_rad: float) -> tuple[float, float, float, float]:
    """Returns the quaternion (x, y, z, w) of the optical frame of a camera in the frame that carries it.

    Args:
        yaw_rad: How the camera is turned counter-clockwise.
        pitch_rad: How it is turned down then.
    """
    cy, sy, cp, sp = (f(each / 2) for each in (yaw_rad, pitch_rad) for f in (math.cos, math.sin))
    # Yaw about z, pitch about y; then z ahead, x to the right and y down: (-1, 1, -1, 1) / 2.
    w, x, y, z = cy * cp, -sy * sp, cy * sp, sy * cp
    return (-w + x - y - z) / 2, (w + x + y - z) / 2, (-w + x + y + z) / 2, (w + x - y + z) / 2
