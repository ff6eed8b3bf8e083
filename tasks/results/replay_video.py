"""Pictures as an MP4 file (H.264). Needs the extra ``video``."""

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from jaxtyping import UInt8

_CODEC, _PIXELS = "libx264", "yuv420p"  # what browsers and slides play
_OPTIONS = {"crf": "23", "preset": "veryfast"}


def write_video(path: Path, pictures: Iterable[UInt8[np.ndarray, "rows columns 3"]], rate_hz: int) -> int:
    """Returns how many pictures were written.

    Args:
        path: The file, overwritten.
        pictures: At least one, all of one size, its sides even.
        rate_hz: Pictures a second.
    """
    count = 0
    with av.open(str(path), "w") as film:
        stream = film.add_stream(_CODEC, rate=rate_hz, options=_OPTIONS)
        stream.pix_fmt = _PIXELS
        for picture in pictures:
            if not count:
                stream.height, stream.width = picture.shape[:2]
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
            frame.pts, frame.time_base = count, Fraction(1, rate_hz)
            film.mux(stream.encode(frame))
            count += 1
        film.mux(stream.encode())
    return count
