"""The picture of a depth camera: exact intersections of the pixels' rays with all solids, the floor and the ceiling.

A solid is upright, so a ray is in it where it is within its outline, seen from above, and between its heights. The
heights decide by the picture's row alone. The outline decides by its column alone if the camera is level: all rays of a
column then lie in one upright plane, which cuts each outline once. A camera that is turned down cuts it for each pixel.
Only solids in the field of view are looked at, whatever the world holds.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32

from specs.data.world import MOST_CORNERS, World
from tasks.simulate.geometry.lidar_scan import divisor, filled_rows, inverse
from tasks.simulate.geometry.obstacles import PARKING_M, bucket_size, half_planes, obstacles

Arrays = Any  # of NumPy on the host, of JAX in a program
# Counts are rounded up to these, doubled as often as need be; where no world has prisms, there are no places for them.
_LEAST = (128, 32, 32)
_SPECK_M = 0.05
_PARKED = (PARKING_M, PARKING_M, 0.0, _SPECK_M)
_UNUSED = (
    (*_PARKED, _SPECK_M, _SPECK_M, 1.0, 0.0),
    (*_PARKED, _SPECK_M),
    (*_PARKED, _SPECK_M, *(0.0, 0.0, -1.0) * MOST_CORNERS),
)
# Higher than a camera sees.
_NO_CEILING_M = 1e6


class DepthScene(NamedTuple):
    """What a depth camera can see of a world (metres); each solid begins with (x, y, lowest, highest).

    Attributes:
        boxes: (..., half x, half y, cos yaw, sin yaw).
        cylinders: (..., radius).
        prisms: (..., radius of the circle around it, half-planes): eight (outward normal x, y, how far out).
        ceiling_m: Its height; imported worlds have none, and very much here.
    """

    boxes: Float[Arrays, "boxes 8"]
    cylinders: Float[Arrays, "cylinders 5"]
    prisms: Float[Arrays, "prisms 29"]
    ceiling_m: Float[Arrays, "1"]


def depth_scene(world: World) -> DepthScene:
    """Returns what a depth camera can see of a world, without padding."""
    boxes, cylinders, prisms = (each.astype(np.float64) for each in obstacles(world, -np.inf, np.inf))
    reach_m = np.hypot(prisms[:, 4::2], prisms[:, 5::2]).max(axis=1, initial=0.0)[:, None]
    planes = half_planes(prisms.astype(np.float32)).reshape(-1, 3 * MOST_CORNERS)
    kinds = (
        np.hstack([_where(boxes, 5), boxes[:, 3:5], boxes[:, 6:8]]),
        np.hstack([_where(cylinders, 4), cylinders[:, 3:4]]),
        np.hstack([_where(prisms, 3), reach_m, planes]),
    )
    ceiling_m = world.ceiling_height_m if world.source is None else _NO_CEILING_M
    return DepthScene(*(each.astype(np.float32) for each in kinds), ceiling_m=np.array([ceiling_m], np.float32))


def _where(solids: Float[np.ndarray, "solids numbers"], half: int) -> Float[np.ndarray, "solids 4"]:
    """Returns where solids stand: (x, y, lowest, highest), given the column of half their height."""
    z, half_m = solids[:, 2:3], solids[:, half : half + 1]
    return np.hstack([solids[:, :2], z - half_m, z + half_m])


def pad_scenes(worlds: Iterable[DepthScene]) -> list[DepthScene]:
    """Returns the worlds' solids with parked specks added, so that all have the same, bucketed counts."""
    given = list(worlds)
    most = [max((len(each[kind]) for each in given), default=0) for kind in range(len(_LEAST))]
    sizes = [bucket_size(count, least) for count, least in zip(most, _LEAST, strict=True)]
    sizes[-1] = sizes[-1] if most[-1] else 0
    return [
        DepthScene(
            *(filled_rows(*kind) for kind in zip(each[:-1], sizes, _UNUSED, strict=True)), ceiling_m=each.ceiling_m
        )
        for each in given
    ]


class View(NamedTuple):
    """A camera's picture: of square pixels, its field of view from the left edge to the right one.

    Attributes:
        pitch_rad: How far it is turned down.
        range_m: The depth of what is farther, or not there.
    """

    columns: int
    rows: int
    fov_rad: float
    pitch_rad: float
    range_m: float

    @property
    def focal_px(self) -> float:
        """Returns the focal length."""
        return self.columns / 2 / math.tan(self.fov_rad / 2)


class Rays(NamedTuple):
    """Parts of a picture's rays, each of which goes 1 m along the camera's axis: seen from the robot."""

    ahead: Float32[np.ndarray, "#rows 1"]
    left: Float32[np.ndarray, "1 columns"]
    up: Float32[np.ndarray, "rows 1"]


def rays_of(view: View) -> Rays:
    """Returns the rays of a picture; those of a level camera are all equally long ahead, and stand once."""
    # In double precision, as the lidar's: NumPy's sines of single ones have other last bits on some processors.
    right = (np.arange(view.columns) + 0.5 - view.columns / 2) / view.focal_px
    down = ((np.arange(view.rows) + 0.5 - view.rows / 2) / view.focal_px)[:, None]
    cos, sin = math.cos(view.pitch_rad), math.sin(view.pitch_rad)
    ahead = cos - down * sin if view.pitch_rad else np.ones((1, 1))
    return Rays(*(each.astype(np.float32) for each in (ahead, -right[None], -sin - down * cos)))


Eye = Float[Array, "4"]
Picture = Float[Array, "rows columns"]
Solid = Float[Array, "numbers"]
# Where rays enter an outline and leave it, as depths, of each column or of each pixel.
Cut = tuple[Float[Array, "#rows columns"], Float[Array, "#rows columns"]]
_TOGETHER = 4


def depth_picture(scene: DepthScene, eye: Eye, view: View, *, floor: bool = True) -> Picture:
    """Returns the depth of each pixel, the upper left one first: how far along the camera's axis what it sees lies.

    What a camera is inside of it does not see.

    Args:
        scene: Of the world.
        eye: Where the camera is: (x m, y m, z m, yaw rad).
        view: Its picture.
        floor: Whether it sees floor and ceiling.
    """
    rays = rays_of(view)
    cos, sin = jnp.cos(eye[3]), jnp.sin(eye[3])
    x, y = cos * rays.ahead - sin * rays.left, sin * rays.ahead + cos * rays.left
    per_up = 1.0 / np.where(np.abs(rays.up) > 1e-9, rays.up, np.float32(1e-9))
    nearest = jnp.full((view.rows, view.columns), view.range_m, eye.dtype)
    for plane_m in (0.0, scene.ceiling_m[0]) if floor else ():
        away = jnp.broadcast_to((plane_m - eye[2]) * per_up, nearest.shape)
        nearest = jnp.where((away > 0.0) & (away < nearest), away, nearest)

    def box(solid: Solid, dx: Array, dy: Array) -> Cut:
        cos, sin = solid[6], solid[7]
        along, across = inverse(cos * x + sin * y), inverse(cos * y - sin * x)
        middle_x, middle_y = (cos * dx + sin * dy) * along, (cos * dy - sin * dx) * across
        reach_x, reach_y = solid[4] * jnp.abs(along), solid[5] * jnp.abs(across)
        enter = jnp.maximum(middle_x - reach_x, middle_y - reach_y)
        return enter, jnp.minimum(middle_x + reach_x, middle_y + reach_y)

    def cylinder(solid: Solid, dx: Array, dy: Array) -> Cut:
        per_square = inverse(x * x + y * y)
        middle, beside = (dx * x + dy * y) * per_square, dx * y - dy * x
        half_chord_2 = (solid[4] ** 2 - beside**2 * per_square) * per_square
        half = jnp.sqrt(jnp.maximum(half_chord_2, 0.0))
        return middle - half, jnp.where(half_chord_2 > 0.0, middle + half, -jnp.inf)

    def prism(solid: Solid, dx: Array, dy: Array) -> Cut:
        enter, leave = jnp.full_like(x, -jnp.inf), jnp.full_like(x, jnp.inf)
        for column in range(5, 5 + 3 * MOST_CORNERS, 3):
            normal_x, normal_y, out = (solid[k] for k in range(column, column + 3))
            facing = divisor(normal_x * x + normal_y * y)
            meets = (normal_x * dx + normal_y * dy + out) * (1.0 / facing)
            enter = jnp.where((facing < 0.0) & (meets > enter), meets, enter)
            leave = jnp.where((facing >= 0.0) & (meets < leave), meets, leave)
        return enter, leave

    def past(cut: Callable[[Solid, Array, Array], Cut], nearest: Picture, solid: Solid) -> Picture:
        enter, leave = cut(solid, solid[0] - eye[0], solid[1] - eye[1])
        low, high = (solid[2] - eye[2]) * per_up, (solid[3] - eye[2]) * per_up
        first, last = jnp.minimum(low, high), jnp.maximum(low, high)
        depth = jnp.maximum(enter, first)
        hit = (depth <= jnp.minimum(leave, last)) & (depth >= 0.0)
        return jnp.where(hit & (depth < nearest), depth, nearest)

    reaches = (jnp.hypot(scene.boxes[:, 4], scene.boxes[:, 5]), scene.cylinders[:, 4], scene.prisms[:, 4])
    for solids, reach_m, cut in zip(scene[:-1], reaches, (box, cylinder, prism), strict=True):
        if len(solids):
            seen = _in_view(solids, reach_m, eye, view, rays)
            nearest = _past_all(lambda before, solid, cut=cut: past(cut, before, solid), nearest, solids, seen)
    return nearest


def _in_view(
    solids: Float[Array, "solids numbers"], reach_m: Float[Array, "solids"], eye: Eye, view: View, rays: Rays
) -> Bool[Array, "solids"]:
    """Returns which solids may be in a picture, by the circles around them, seen from above."""
    cos, sin = jnp.cos(eye[3]), jnp.sin(eye[3])
    dx, dy = solids[:, 0] - eye[0], solids[:, 1] - eye[1]
    ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
    farthest = view.range_m * math.hypot(float(np.abs(rays.ahead).max()), float(rays.left.max()))
    seen = dx**2 + dy**2 <= (farthest + reach_m + _SPECK_M) ** 2
    if rays.ahead.min() <= 0.0:
        return seen  # it looks straight down, or up, somewhere
    slope = float(rays.left.max() / rays.ahead.min())
    return seen & (jnp.abs(left) - slope * ahead <= (reach_m + _SPECK_M) * math.hypot(1.0, slope))


def _past_all(
    past: Callable[[Picture, Solid], Picture],
    nearest: Picture,
    solids: Float[Array, "solids numbers"],
    seen: Bool[Array, "solids"],
) -> Picture:
    """Returns the depths after the solids that are seen, some at a time; others among the last ones change nothing."""
    kept = solids[jnp.nonzero(seen, size=len(solids), fill_value=0)[0]]

    def past_some(block: Array, nearest: Picture) -> Picture:
        some = jax.lax.dynamic_slice_in_dim(kept, block * _TOGETHER, _TOGETHER)
        for solid in some:
            nearest = past(nearest, solid)
        return nearest

    return jax.lax.fori_loop(0, (jnp.count_nonzero(seen) + _TOGETHER - 1) // _TOGETHER, past_some, nearest)
