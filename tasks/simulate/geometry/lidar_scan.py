"""The scan of a planar lidar: exact intersections of rays with outlines, all lanes at once.

The outlines of a world in the lidar's plane are sorted by what a ray costs: upright boxes, turned boxes, circles,
prisms. Rays lie in the last axis, so vector units work on neighbouring rays of one lane and every outline is read once.
How many outlines are looked at is decided while running, by the fullest world among the lanes: padding costs nothing.
"""

import functools
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32, Int, Int32

from specs.data.world import MOST_CORNERS
from tasks.simulate.geometry.obstacles import PARKING_M, Obstacles, bucket_size, edge_counts, half_planes

# A box counts as upright when its corners lie this near to those of the upright one: no ray can tell.
_UPRIGHT_M = 1e-6
# Unused places cost memory and no time, so one size fits nearly all worlds; beyond it sizes double.
_LEAST = (256, 64, 64, 64)
# A ray costs what the edges do that it is compared with, so prisms with no more than so many are looked at first.
_SIDES = (4, 6)
_NONE = 2**30
_SPECK_M = 0.05
_FAR_M = (PARKING_M, PARKING_M)
# Specks, and what is on the inner side of no half-plane.
_UNUSED = (
    (*_FAR_M, _SPECK_M, _SPECK_M),
    (*_FAR_M, _SPECK_M, _SPECK_M, 1.0, 0.0),
    (*_FAR_M, _SPECK_M),
    (*_FAR_M, *(0.0, 0.0, -1.0) * MOST_CORNERS),
)


class LidarOutlines(NamedTuple):
    """What a lidar can see of a world (metres).

    Attributes:
        upright: Boxes along the axes (x, y, half x, half y).
        turned: Other boxes (x, y, half x, half y, cos yaw, sin yaw).
        circles: (x, y, radius).
        prisms: (x, y, half-planes): eight (outward normal x, y, how far out from the middle), those with few edges
            first; empty where no world of the chunk has any.
        counts: How many of each there are; what follows them is padding. Then, for each of ``_SIDES``, how many prisms
            come before the first one with more edges; very many if there is none.
    """

    upright: Float[jax.Array, "upright 4"]
    turned: Float[jax.Array, "turned 6"]
    circles: Float[jax.Array, "circles 3"]
    prisms: Float[jax.Array, "prisms 26"]
    counts: Int[jax.Array, "6"]


class HostLidarOutlines(NamedTuple):
    """Silhouettes before they go to a device; fields as there."""

    upright: Float32[np.ndarray, "upright 4"]
    turned: Float32[np.ndarray, "turned 6"]
    circles: Float32[np.ndarray, "circles 3"]
    prisms: Float32[np.ndarray, "prisms 26"]
    counts: Int32[np.ndarray, "6"]


def lidar_outlines(seen: Obstacles) -> HostLidarOutlines:
    """Returns the outlines of the obstacles that cross the lidar's plane, without padding."""
    boxes = seen.boxes.astype(np.float64)
    half, turn = boxes[:, 3:5], boxes[:, 6:8]
    off = np.abs(turn).min(axis=1, initial=1.0) * half.max(axis=1, initial=0.0)
    upright = off <= _UPRIGHT_M
    across = np.abs(turn[:, 1]) > np.abs(turn[:, 0])
    half_along = np.where(across[:, None], half[:, ::-1], half)
    straight = np.hstack([boxes[:, :2], half_along])[upright]
    turned = np.hstack([boxes[:, :2], half, turn])[~upright]
    circles = seen.cylinders[:, [0, 1, 3]]
    sides = edge_counts(seen.prisms)
    planes = half_planes(seen.prisms).reshape(-1, 3 * MOST_CORNERS)
    prisms = np.hstack([seen.prisms[:, :2], planes])[np.argsort(sides, kind="stable")]
    kinds = [each.astype(np.float32) for each in (straight, turned, circles, prisms)]
    before = [int((sides <= most).sum()) if (sides > most).any() else _NONE for most in _SIDES]
    return HostLidarOutlines(*kinds, counts=np.array([*map(len, kinds), *before], np.int32))


def pad_lidar_outlines(worlds: Iterable[HostLidarOutlines]) -> list[HostLidarOutlines]:
    """Returns the worlds' outlines with parked specks added, so that all have the same, bucketed sizes."""
    given = list(worlds)
    # By what the arrays hold, not by how many outlines there are: some may be filled up already.
    most = [max((len(each[kind]) for each in given), default=0) for kind in range(len(_LEAST))]
    sizes = [bucket_size(count, least) for count, least in zip(most, _LEAST, strict=True)]
    sizes[-1] = sizes[-1] if most[-1] else 0
    return [
        HostLidarOutlines(
            *(filled_rows(*kind) for kind in zip(each[:-1], sizes, _UNUSED, strict=True)), counts=each.counts
        )
        for each in given
    ]


def filled_rows(
    shapes: Float32[np.ndarray, "shapes columns"], size: int, unused: tuple[float, ...]
) -> Float32[np.ndarray, "size columns"]:
    """Returns so many shapes: the given ones, then the same one again and again, which nobody sees."""
    return np.concatenate([shapes, np.tile(np.array(unused, np.float32), (size - len(shapes), 1))])


# A direction's part below this would divide by zero; raising it turns a ray by far less than a beam's width.
_TINY = 1e-9
_TOGETHER = 8
# More take longer to compile, and no less time.
_PRISMS_TOGETHER = 4
Rays = Float[Array, "lanes rays"]
Outlines = Float[Array, "lanes columns"]


def scan_ranges(
    seen: LidarOutlines, pose: Float[Array, "3"], angles: Float32[np.ndarray, "rays"], range_m: float
) -> Float[Array, "rays"]:
    """Returns the distance along each ray to the nearest outline, at most the range.

    Args:
        seen: What crosses the lidar's plane.
        pose: (x m, y m, yaw rad) of the lidar.
        angles: The rays' directions in the lidar's frame, radians.
        range_m: Where nothing is nearer.
    """
    # In double precision: NumPy's sines of single ones have other last bits on processors without AVX2.
    exact_rad = angles.astype(np.float64)
    rays = jnp.asarray(np.stack([np.cos(exact_rad), np.sin(exact_rad)]), pose.dtype)
    return _scan_lane(seen, pose, rays, jnp.asarray(range_m, pose.dtype))


@jax.custom_batching.custom_vmap
def _scan_lane(
    seen: LidarOutlines, pose: Float[Array, "3"], rays: Float[Array, "2 rays"], range_m: Float[Array, ""]
) -> Float[Array, "rays"]:
    return _scan_lanes(LidarOutlines(*(each[None] for each in seen)), pose[None], rays, range_m)[0]


@_scan_lane.def_vmap
def _scan_mapped(  # noqa: PLR0917 - JAX's own form
    lanes: int,
    mapped: Sequence[Any],
    seen: LidarOutlines,
    pose: Array,
    rays: Array,
    range_m: Array,
) -> tuple[Rays, bool]:
    """Returns the ranges of all lanes. Mapped one by one, each would have a loop of its own length."""

    def repeated(array: Array, is_mapped: bool) -> Array:  # noqa: FBT001 - JAX's own form
        return array if is_mapped else jnp.broadcast_to(array, (lanes, *array.shape))

    each_seen = LidarOutlines(*map(repeated, seen, mapped[0]))
    return _scan_lanes(each_seen, repeated(pose, mapped[1]), rays, range_m), True


def _scan_lanes(
    seen: LidarOutlines, pose: Float[Array, "lanes 3"], rays: Float[Array, "2 rays"], range_m: Float[Array, ""]
) -> Rays:
    """Returns the ranges of all lanes; ``seen`` has the lanes in front."""
    cos, sin = jnp.cos(pose[:, 2:]), jnp.sin(pose[:, 2:])
    ray_x, ray_y = cos * rays[0] - sin * rays[1], sin * rays[0] + cos * rays[1]
    per_x, per_y = inverse(ray_x), inverse(ray_y)
    reach_x, reach_y = jnp.abs(per_x), jnp.abs(per_y)
    x, y = pose[:, 0:1], pose[:, 1:2]

    def past_upright(nearest: Rays, box: Outlines) -> Rays:
        middle = (box[:, 0:1] - x) * per_x, (box[:, 1:2] - y) * per_y
        return _past_slabs(nearest, middle, (box[:, 2:3] * reach_x, box[:, 3:4] * reach_y))

    def past_turned(nearest: Rays, box: Outlines) -> Rays:
        turn_x, turn_y = box[:, 4:5], box[:, 5:6]
        dx, dy = box[:, 0:1] - x, box[:, 1:2] - y
        along = inverse(turn_x * ray_x + turn_y * ray_y)
        across = inverse(turn_x * ray_y - turn_y * ray_x)
        middle = (turn_x * dx + turn_y * dy) * along, (turn_x * dy - turn_y * dx) * across
        return _past_slabs(nearest, middle, (box[:, 2:3] * jnp.abs(along), box[:, 3:4] * jnp.abs(across)))

    def past_circle(nearest: Rays, circle: Outlines) -> Rays:
        dx, dy = circle[:, 0:1] - x, circle[:, 1:2] - y
        along, across = dx * ray_x + dy * ray_y, dx * ray_y - dy * ray_x
        half_chord_2 = circle[:, 2:3] ** 2 - across**2
        entry = along - jnp.sqrt(jnp.where(half_chord_2 > 0.0, half_chord_2, 0.0))
        return _nearer(nearest, entry, half_chord_2 > 0.0)

    def past_prism(sides: int, nearest: Rays, prism: Outlines) -> Rays:
        dx, dy = prism[:, 0:1] - x, prism[:, 1:2] - y
        entry, leave = jnp.full_like(nearest, -jnp.inf), jnp.full_like(nearest, jnp.inf)
        for column in range(2, 2 + 3 * sides, 3):
            normal_x, normal_y, out = (prism[:, k : k + 1] for k in range(column, column + 3))
            facing = normal_x * ray_x + normal_y * ray_y
            meets = (normal_x * dx + normal_y * dy + out) * inverse(facing)
            entry = jnp.where((facing < 0.0) & (meets > entry), meets, entry)
            leave = jnp.where((facing >= 0.0) & (meets < leave), meets, leave)
        return _nearer(nearest, entry, entry <= leave)

    nearest = jnp.full(ray_x.shape, range_m)
    most = jnp.max(seen.counts, axis=0)
    nearest = _past_all(past_upright, nearest, seen.upright, most[0])
    nearest = _past_all(past_turned, nearest, seen.turned, most[1])
    nearest = _past_all(past_circle, nearest, seen.circles, most[2])
    if not seen.prisms.shape[1]:
        return nearest
    # The lane whose prisms have more edges decides; with more than there are, some edges are looked at again.
    before = jnp.min(seen.counts[:, len(_LEAST) :], axis=0)
    first = jnp.zeros_like(most[3])
    for sides, end in zip((*_SIDES, MOST_CORNERS), (*before, most[3]), strict=True):
        whole = _whole(end, most[3])
        past = functools.partial(past_prism, sides)
        nearest = _past_all(past, nearest, seen.prisms, whole, first=first, together=_PRISMS_TOGETHER)
        first = whole
    return nearest


def _whole(end: Array, most: Array) -> Array:
    """Returns an end of prisms that are looked at together: all of them, or the last one before that divides them."""
    return jnp.where(end < most, end // _PRISMS_TOGETHER * _PRISMS_TOGETHER, most)


def _past_all(
    past: Callable[[Rays, Outlines], Rays],
    nearest: Rays,
    outlines: Float[Array, "lanes outlines columns"],
    end: Array,
    *,
    first: Array | int = 0,
    together: int = _TOGETHER,
) -> Rays:
    """Returns the ranges after outlines, some at a time: sizes are multiples of that.

    Args:
        past: Returns the ranges after one more outline of each lane.
        nearest: The ranges before.
        outlines: Of all lanes.
        end: The place after the last one.
        first: The place of the first one, a multiple of how many are looked at at a time, or the end.
        together: So many.
    """

    def past_some(block: Array, nearest: Rays) -> Rays:
        some = jax.lax.dynamic_slice_in_dim(outlines, block * together, together, axis=1)
        return functools.reduce(past, (some[:, k] for k in range(together)), nearest)

    def blocks(place: Array | int) -> Array | int:
        return (place + together - 1) // together

    return jax.lax.fori_loop(blocks(first), blocks(end), past_some, nearest)


def _past_slabs(nearest: Rays, middle: tuple[Rays, Rays], reach: tuple[Rays, Rays]) -> Rays:
    """Returns the ranges after a box, given where each ray passes its middle and how far it is inside its slabs."""
    near_x, near_y = middle[0] - reach[0], middle[1] - reach[1]
    far_x, far_y = middle[0] + reach[0], middle[1] + reach[1]
    entry = jnp.where(near_x > near_y, near_x, near_y)
    leave = jnp.where(far_x < far_y, far_x, far_y)
    return _nearer(nearest, entry, entry <= leave)


def _nearer(nearest: Rays, entry: Rays, hit: Bool[Array, "lanes rays"]) -> Rays:
    return jnp.where(hit & (entry >= 0.0) & (entry < nearest), entry, nearest)


def inverse(part: Rays) -> Rays:
    """Returns one by a part of a direction, also where that is 0."""
    return 1.0 / jnp.where(jnp.abs(part) > _TINY, part, _TINY)
