"""What a robot's cameras saw, as pictures for people: depths become colours, from near to far."""

import base64
from collections.abc import Iterator
from io import BytesIO
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image

from tasks.results.playback.playback import CameraFilm, Playback
from tasks.ros.message.camera_messages import jpeg_bytes

Pixels = UInt8[np.ndarray, "rows columns 3"]
# Near is light and far is dark, also for who tells no colours apart: viridis, a map of matplotlib's (CC0), backwards.
_NEAR_TO_FAR = np.array(
    [(253, 231, 37), (122, 209, 81), (34, 168, 132), (42, 120, 142), (65, 68, 135), (68, 1, 84)], np.float64
)
_SHADES, _NOTHING = 63, (22, 24, 28)
_PLACES = np.linspace(0, len(_NEAR_TO_FAR) - 1, _SHADES)
_MAP = np.stack([np.interp(_PLACES, np.arange(len(_NEAR_TO_FAR)), channel) for channel in _NEAR_TO_FAR.T], axis=1)
PALETTE: UInt8[np.ndarray, "shades 3"] = np.round(np.vstack([_MAP, np.array([_NOTHING])])).astype(np.uint8)
"""The colours of depths, from near to far, and last that of pixels that saw nothing."""


class RobotView(NamedTuple):
    """What one camera of a robot saw.

    Attributes:
        film: Its pictures, at least one.
        label: What they show, for a person.
        far_m: The depth that has the last colour; None for pictures in colour.
    """

    film: CameraFilm
    label: str
    far_m: float | None

    def at(self, t_s: float) -> int:
        """Returns which picture was the last one at a time."""
        return max(0, int(np.searchsorted(self.film.t_s, t_s + 1e-9, side="right")) - 1)

    def shades(self, number: int) -> UInt8[np.ndarray, "rows columns"]:
        """Returns a picture of depths as numbers of `PALETTE`."""
        return depth_shades(self.film.pictures[number], self.far_m or 1.0, self.film.camera.range_m)

    def pixels(self, number: int) -> Pixels:
        """Returns a picture in colours."""
        return self.film.pictures[number] if self.far_m is None else PALETTE[self.shades(number)]


def robot_views(playback: Playback) -> Iterator[RobotView]:
    """Yields what each of the robot's cameras saw, first the depth camera's; nothing for a robot without any."""
    if playback.depth and len(playback.depth.t_s):
        far_m = farthest_m(playback.depth.pictures, playback.depth.camera.range_m)
        for film in playback.depth.apart:
            yield RobotView(film, _label(film, f"depth, light 0 m to dark {far_m:.1f} m"), far_m)
    if playback.color and len(playback.color.t_s):
        for film in playback.color.apart:
            yield RobotView(film, _label(film, "colour"), None)


def _label(film: CameraFilm, shown: str) -> str:
    return f"{film.camera.name}: {shown}" if film.camera.name else shown


def farthest_m(depth_m: Float[np.ndarray, "*pictures rows columns"], range_m: float) -> float:
    """Returns the largest depth that was seen within the range, so that colours are spent on what there is."""
    return float(np.max(depth_m, where=depth_m < np.float32(range_m), initial=0.1))


def depth_shades(
    depth_m: Float[np.ndarray, "rows columns"], far_m: float, range_m: float
) -> UInt8[np.ndarray, "rows columns"]:
    """Returns depths as numbers of `PALETTE`.

    Args:
        depth_m: Of each pixel.
        far_m: The depth that has the last colour.
        range_m: What the camera reports where it sees nothing.
    """
    shade: Int[np.ndarray, "rows columns"] = np.floor(np.clip(depth_m / far_m, 0.0, 1.0) * (_SHADES - 1)).astype(int)
    return np.where(depth_m < np.float32(range_m), shade, _SHADES).astype(np.uint8)


def picture_url(view: RobotView, number: int, most_px: int) -> str:
    """Returns a picture as a URL that holds it: PNG of depths, JPEG of colours.

    Args:
        view: What a camera saw.
        number: Which of its pictures.
        most_px: A picture with longer sides is shown with fewer pixels.
    """
    rows, columns = view.film.pictures.shape[1:3]
    every = -(-max(rows, columns) // most_px)
    if view.far_m is None:
        return image_url(jpeg_bytes(view.pixels(number)[::every, ::every]))
    return image_url(shades_png(view.shades(number)[::every, ::every]))


def shades_png(shades: UInt8[np.ndarray, "rows columns"]) -> bytes:
    """Returns numbers of `PALETTE` as a PNG in its colours."""
    image, packed = Image.fromarray(shades), BytesIO()
    image.putpalette(PALETTE.tobytes())
    image.save(packed, "png", optimize=True)
    return packed.getvalue()


def image_url(packed: bytes) -> str:
    """Returns a PNG or a JPEG as a URL that holds it."""
    kind = "png" if packed.startswith(b"\x89PNG") else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(packed).decode()}"
