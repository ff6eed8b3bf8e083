"""Draws an episode from above, picture by picture, and writes pictures as an MP4 file (H.264).

Needs the extra ``video``: Pillow and PyAV.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageChops, ImageDraw

from specs.data.mover_colors import BOX, OTHER, PERSON, ROBOT
from specs.data.people import PERSON_RADIUS_M
from specs.data.world import Color, Solid, World, below_heads, corners_m
from tasks.results.playback.playback import Playback
from tasks.results.playback.robot_view import RobotView, robot_views

Pixels = UInt8[np.ndarray, "rows columns 3"]
_SIDE = 960
_EDGE = 24
_HEADING = 34
# What a camera saw, beside the plan: how wide, and the room for its label. The whole is even.
_VIEW, _LABEL = 400, 26
_CUT_M = 1.45
_PAPER, _INK, _WALL = (255, 255, 255), (32, 33, 36), (43, 47, 51)
_WAY, _TOUCH, _GOAL = (176, 96, 0), (197, 34, 31), (24, 128, 56)
_ZONE = (95, 104, 112)
_SCAN, _SCAN_ALPHA = (23, 105, 210), 0.16


def frames(world: World, playback: Playback, stride: int = 1) -> Iterator[Pixels]:
    """Yields a picture for every ``stride`` samples of an episode, and for its end; all of one even size.

    Beside the plan is what the robot's cameras saw, if it has any.

    Args:
        world: Where it took place.
        playback: What the robot did.
        stride: At least 1.
    """
    stage, views = _Stage(world, playback), tuple(robot_views(playback))
    for sample in playback.every(stride):
        yield _beside_views(stage.picture(int(sample)), views, float(playback.t_s[sample]))


def with_captions(pictures: Iterable[Pixels], playback: Playback, samples: Sequence[int]) -> Iterator[Pixels]:
    """Yields pictures of samples with the job, the time and the ending on each, and what the robot saw beside it."""
    views = tuple(robot_views(playback))
    for picture, sample in zip(pictures, samples, strict=True):
        image = Image.fromarray(picture)
        _caption(ImageDraw.Draw(image), playback, sample)
        yield _beside_views(image, views, float(playback.t_s[sample]))


def _caption(draw: ImageDraw.ImageDraw, playback: Playback, sample: int) -> None:
    text = f"{playback.job}   {playback.t_s[sample]:6.2f} s   {playback.ending}"
    draw.text((_EDGE, 10), text, fill=_INK, font_size=18)


def _beside_views(image: Image.Image, views: Sequence[RobotView], t_s: float) -> Pixels:
    """Returns a picture with what each camera of the robot saw last at a time in a column to the right of it."""
    if not views:
        return np.asarray(image)
    page = Image.new("RGB", (image.width + _VIEW + _EDGE, image.height), _PAPER)
    page.paste(image)
    draw, top = ImageDraw.Draw(page), _EDGE + _HEADING
    most = (image.height - top) // len(views) - _LABEL - _EDGE
    for view in views:
        seen = Image.fromarray(view.pixels(view.at(t_s)))
        shrunk = min(1.0, most * seen.width / (_VIEW * seen.height))
        width = round(_VIEW * shrunk)
        shown = seen.resize((width, round(width * seen.height / seen.width)), Image.Resampling.NEAREST)
        draw.text((image.width, top), view.label, fill=_INK, font_size=16)
        page.paste(shown, (image.width, top + _LABEL))
        top += _LABEL + shown.height + _EDGE
    return np.asarray(page)


class _Stage:
    """A world drawn once, and the robot on it again and again."""

    def __init__(self, world: World, playback: Playback) -> None:
        area = world.footprint
        across_m, up_m = area.x_max_m - area.x_min_m, area.y_max_m - area.y_min_m
        self._scale = (_SIDE - 2 * _EDGE) / max(across_m, up_m)
        self._left_m, self._top_m, self._playback = area.x_min_m, area.y_max_m, playback
        size = (_even(across_m * self._scale + 2 * _EDGE), _even(up_m * self._scale + 2 * _EDGE + _HEADING))
        self._ground = self._drawn(Image.new("RGB", size, _PAPER), world)
        # Where nothing is seen, rays end far outside.
        self._inside = Image.new("L", size, 0)
        ImageDraw.Draw(self._inside).rectangle(
            [self._at((area.x_min_m, area.y_max_m)), self._at((area.x_max_m, area.y_min_m))], fill=255
        )
        self._way = [self._at(pose[:2]) for pose in playback.pose]
        self._touches = playback.touches()

    def picture(self, sample: int) -> Image.Image:
        """Returns the picture of one sample."""
        image = self._with_scan(sample)
        draw = ImageDraw.Draw(image)
        playback = self._playback
        for number, goal in enumerate(playback.goals_m):
            reached = playback.goal_index[sample] > number
            self._disc(draw, goal, playback.arrived_m or 0.1, outline=_GOAL, fill=_GOAL if reached else None)
        if sample:
            draw.line(self._way[: sample + 1], fill=_WAY, width=3, joint="curve")
        for touch in self._touches[self._touches <= sample]:
            self._disc(draw, playback.pose[touch, :2], playback.radius_m + 0.06, outline=_TOUCH)
        for (x, y), (wide, deep, _) in playback.boxes.standing(sample) if playback.boxes else ():
            corners = [self._at((x - wide / 2, y + deep / 2)), self._at((x + wide / 2, y - deep / 2))]
            draw.rectangle(corners, fill=BOX, outline=_INK)
        for person_m in playback.people_m[sample]:
            self._disc(draw, person_m, PERSON_RADIUS_M, outline=_INK, fill=PERSON)
        for other_m in playback.robots_m[sample]:
            self._disc(draw, other_m, playback.radius_m, outline=_INK, fill=OTHER)
        x, y, yaw = (float(each) for each in playback.pose[sample])
        if playback.shape:
            self._robot(draw, x, y, yaw)
        else:
            self._disc(draw, (x, y), playback.radius_m, outline=_INK, fill=ROBOT)
        tip = (x + playback.radius_m * math.cos(yaw), y + playback.radius_m * math.sin(yaw))
        draw.line([self._at((x, y)), self._at(tip)], fill=_INK, width=3)
        _caption(draw, playback, sample)
        return image

    def _robot(self, draw: ImageDraw.ImageDraw, x: float, y: float, yaw: float) -> None:
        """Draws the robot's parts, the lowest first, then all of their edges: one inside another is seen as well."""
        cos, sin = math.cos(yaw), math.sin(yaw)
        outlines = [
            [self._at((x + cos * u - sin * v, y + sin * u + cos * v)) for u, v in part.outline_m]
            for part in self._playback.shape
        ]
        for part, outline in zip(self._playback.shape, outlines, strict=True):
            draw.polygon(outline, _bytes(part.color[:3]))
        for outline in outlines:
            draw.polygon(outline, outline=_INK)

    def _with_scan(self, sample: int) -> Image.Image:
        if not self._playback.acted[sample] or self._playback.ranges_m.shape[1] < 3:
            return self._ground.copy()
        seen = Image.new("L", self._ground.size, 0)
        outline = [self._at(point) for point in self._playback.seen_m(sample)]
        ImageDraw.Draw(seen).polygon(outline, fill=round(255 * _SCAN_ALPHA))
        blue = Image.new("RGB", self._ground.size, _SCAN)
        return Image.composite(blue, self._ground, ImageChops.multiply(seen, self._inside))

    def _drawn(self, image: Image.Image, world: World) -> Image.Image:
        draw = ImageDraw.Draw(image)
        for room in world.rooms:
            low, high = (
                self._at((room.floor.x_min_m, room.floor.y_max_m)),
                self._at((room.floor.x_max_m, room.floor.y_min_m)),
            )
            red, green, blue = (0.5 + channel / 2 for channel in room.flooring.color)
            draw.rectangle([low, high], fill=_bytes((red, green, blue)))
        for zone in world.zones or ():
            draw.polygon([self._at(corner) for corner in zone.outline_m], outline=_ZONE)
        leaves = [door.leaf for door in world.doors]
        pieces = [solid for piece in below_heads(world.furniture) for solid in piece.solids]
        for solid in sorted(pieces, key=lambda each: each.center_m[2] + each.half_extents_m[2]):
            self._solid(draw, solid, _bytes(solid.color))
        for solid in (*world.walls, *leaves):
            if solid.center_m[2] - solid.half_extents_m[2] < _CUT_M:
                self._solid(draw, solid, _WALL)
        return image

    def _solid(self, draw: ImageDraw.ImageDraw, solid: Solid, fill: tuple[int, int, int]) -> None:
        if solid.shape == "cylinder":
            self._disc(draw, solid.center_m[:2], solid.half_extents_m[0], outline=_INK, fill=fill, width=1)
            return
        draw.polygon([self._at(corner) for corner in corners_m(solid)], fill, _INK)

    def _disc(
        self,
        draw: ImageDraw.ImageDraw,
        at_m: Sequence[float] | np.ndarray,
        radius_m: float,
        *,
        outline: tuple[int, int, int],
        fill: tuple[int, int, int] | None = None,
        width: int = 2,
    ) -> None:
        (x, y), radius = self._at(at_m), radius_m * self._scale
        draw.ellipse([x - radius, y - radius, x + radius, y + radius], fill, outline, width)

    def _at(self, at_m: Sequence[float] | np.ndarray) -> tuple[float, float]:
        x, y = float(at_m[0]), float(at_m[1])
        return _EDGE + (x - self._left_m) * self._scale, _HEADING + _EDGE + (self._top_m - y) * self._scale


def _even(length: float) -> int:
    """Returns a length in pixels as video codecs want it."""
    return 2 * math.ceil(length / 2)


def _bytes(color: Color) -> tuple[int, int, int]:
    red, green, blue = (round(255 * channel) for channel in color)
    return red, green, blue


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
