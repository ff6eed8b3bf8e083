"""The scan of a planar lidar: exact intersections of rays with outlines, all lanes at once.

The outlines of a world in the lidar's plane are sorted by what a ray costs: upright boxes, turned boxes, circles,
prisms of few corners and of more. Rays lie in the last axis, so vector units work on neighbouring rays of one lane and
every outline is read once. How many outlines are looked at is decided while running, by the lane that has most of them
within its range: neither padding nor the far end of a hospital costs anything.
"""

import functools
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Float32, Int, Int32

from specs.data.world import MOST_CORNERS
from tasks.simulate.geometry.obstacles import PARKING_M, Obstacles, bucket_size, edge_counts

# A box counts as upright when its corners lie this near to those of the upright one: no ray can tell.
_UPRIGHT_M = 1e-6
# Unused places cost memory and no time, so one size fits nearly all worlds; beyond it sizes double.
_LEAST = (256, 64, 64, 64, 64, 64)
# A ray costs what the edges do that it is compared with: prisms are kept by the most that they may have.
_SIDES = (4, 6, MOST_CORNERS)
_PRISMS = len(_LEAST) - len(_SIDES)
_SPECK_M = 0.05
_FAR_M = (PARKING_M, PARKING_M)
# Specks, and corners that have no edge between them.
_UNUSED = (
    (*_FAR_M, _SPECK_M, _SPECK_M),
    (*_FAR_M, _SPECK_M, _SPECK_M, 1.0, 0.0),
    (*_FAR_M, _SPECK_M),
    *((*_FAR_M, *(0.0, 0.0) * sides) for sides in _SIDES),
)
# A slice looks at what is within range of a lidar that has gone no farther than this since it began.
_ROAM_M = 1.0
# For what single precision rounds of distances, and of coordinates.
_LEAST_M, _OF_COORDINATES = 1e-3, 4e-6


class WithinRange(NamedTuple):
    """How many outlines of each kind, the first ones, can be within range of a lidar that is about a point.

    Attributes:
        center_m: The point (x, y).
        counts: Of each kind.
    """

    center_m: Float[jax.Array, "2"]
    counts: Int[jax.Array, "6"]


class LidarOutlines(NamedTuple):
    """What a lidar can see of a world (metres).

    Attributes:
        upright: Boxes along the axes (x, y, half x, half y).
        turned: Other boxes (x, y, half x, half y, cos yaw, sin yaw).
        circles: (x, y, radius).
        quads, hexagons, octagons: Prisms of at most 4, 6 and 8 corners (x, y, corners): each from the middle (x, y),
            counter-clockwise, the last one repeated; empty where no world of the chunk has any.
        counts: How many of each there are; what follows them is padding.
        within: How many of each are near for some control steps; None if nobody looked.
        people: Who walks about, as circles; None where there is nobody.
        boxes: What was put there, as ``upright``; None where nothing is.
    """

    upright: Float[jax.Array, "upright 4"]
    turned: Float[jax.Array, "turned 6"]
    circles: Float[jax.Array, "circles 3"]
    quads: Float[jax.Array, "quads 10"]
    hexagons: Float[jax.Array, "hexagons 14"]
    octagons: Float[jax.Array, "octagons 18"]
    counts: Int[jax.Array, "6"]
    within: WithinRange | None = None
    people: Float[jax.Array, "people 3"] | None = None
    boxes: Float[jax.Array, "boxes 4"] | None = None

    @property
    def kinds(self) -> tuple[jax.Array, ...]:
        """The outlines, kind by kind."""
        return (self.upright, self.turned, self.circles, self.quads, self.hexagons, self.octagons)


class HostLidarOutlines(NamedTuple):
    """Silhouettes before they go to a device; fields as there."""

    upright: Float32[np.ndarray, "upright 4"]
    turned: Float32[np.ndarray, "turned 6"]
    circles: Float32[np.ndarray, "circles 3"]
    quads: Float32[np.ndarray, "quads 10"]
    hexagons: Float32[np.ndarray, "hexagons 14"]
    octagons: Float32[np.ndarray, "octagons 18"]
    counts: Int32[np.ndarray, "6"]

    @property
    def prisms(self) -> Float32[np.ndarray, "prisms 2"]:
        """The middles (x, y) of all prisms, and of what fills them up."""
        return np.concatenate([kind[:, :2] for kind in self[_PRISMS:-1]])


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
    group = np.searchsorted(_SIDES, edge_counts(seen.prisms))
    prisms = np.hstack([seen.prisms[:, :2], seen.prisms[:, 4:]])
    groups = [prisms[group == place, : 2 + 2 * sides] for place, sides in enumerate(_SIDES)]
    kinds = [each.astype(np.float32) for each in (straight, turned, circles, *groups)]
    return HostLidarOutlines(*kinds, counts=np.array([*map(len, kinds)], np.int32))


def pad_lidar_outlines(worlds: Iterable[HostLidarOutlines]) -> list[HostLidarOutlines]:
    """Returns the worlds' outlines with parked specks added, so that all have the same, bucketed sizes.

    There are no places for prisms if no world has one.
    """
    given = list(worlds)
    # By what the arrays hold, not by how many outlines there are: some may be filled up already.
    most = [max((len(each[kind]) for each in given), default=0) for kind in range(len(_LEAST))]
    sizes = [bucket_size(count, least) for count, least in zip(most, _LEAST, strict=True)]
    sizes[_PRISMS:] = sizes[_PRISMS:] if any(most[_PRISMS:]) else [0] * len(_SIDES)
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


def within_range(seen: LidarOutlines, center_m: Float[Array, "2"], range_m: float) -> LidarOutlines:
    """Returns outlines in another order: those first that a lidar sees before it is a metre from a point.

    Where the least places hold all outlines, they are as they were: a lidar sees most of so small a world.

    Args:
        seen: What crosses the lidar's plane, in one world.
        center_m: The point (x, y).
        range_m: The lidar's.
    """
    if all(len(kind) <= least for kind, least in zip(seen.kinds, _LEAST, strict=True)):
        return seen
    reach_m = range_m + _ROAM_M + _LEAST_M
    ordered: list[Array] = []
    counts: list[Array] = []
    for place, (kind, count) in enumerate(zip(seen.kinds, seen.counts, strict=True)):
        places = jnp.arange(len(kind), dtype=jnp.int32)
        rounded_m = _OF_COORDINATES * (jnp.abs(kind[:, :2]).sum(axis=1) + jnp.abs(center_m).sum())
        near = (_apart_m(place, kind, center_m) <= reach_m + rounded_m) & (places < count)
        rank = jnp.cumsum(near, dtype=jnp.int32)
        target = jnp.where(near, rank - 1, rank[-1:] + places - rank)
        ordered.append(jnp.zeros_like(kind).at[target].set(kind, unique_indices=True))
        counts.append(rank.max(initial=0))
    return LidarOutlines(*ordered, counts=seen.counts, within=WithinRange(center_m, jnp.stack(counts)))


def _apart_m(
    place: int, kind: Float[Array, "outlines columns"], center_m: Float[Array, "2"]
) -> Float[Array, "outlines"]:
    """Returns how far a point is at least from each outline of a kind."""
    dx, dy = kind[:, 0] - center_m[0], kind[:, 1] - center_m[1]
    if place >= _PRISMS:
        corners = kind[:, 2:].reshape(len(kind), kind.shape[1] // 2 - 1, 2)
        along = jnp.roll(corners, -1, axis=1) - corners
        length_m = jnp.sqrt(along[..., 0] ** 2 + along[..., 1] ** 2)
        from_x, from_y = -dx[:, None] - corners[..., 0], -dy[:, None] - corners[..., 1]
        beyond_m = (along[..., 1] * from_x - along[..., 0] * from_y) / jnp.maximum(length_m, _TINY)
        return jnp.where(length_m > 0.0, beyond_m, -jnp.inf).max(axis=1, initial=-jnp.inf)
    around_m = kind[:, 2] if kind.shape[1] == 3 else jnp.sqrt(kind[:, 2] ** 2 + kind[:, 3] ** 2)
    return jnp.sqrt(dx**2 + dy**2) - around_m


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
    return _scan_lanes(jax.tree.map(lambda each: each[None], seen), pose[None], rays, range_m)[0]


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
    each_seen, poses = lanes_in_front(lanes, (seen, pose), (mapped[0], mapped[1]))
    return _scan_lanes(each_seen, poses, rays, range_m), True


# Any tree of arrays.
Given = TypeVar("Given")


def lanes_in_front(lanes: int, given: Given, mapped: object) -> Given:
    """Returns arrays with an axis of lanes in front: what JAX maps has one, and all lanes share the others.

    Args:
        lanes: How many.
        given: What a function that is mapped whole (``custom_vmap``) gets.
        mapped: Which of it have the axis.
    """

    def repeated(array: ArrayLike, is_mapped: bool) -> ArrayLike:  # noqa: FBT001 - JAX's own form
        return array if is_mapped else jnp.broadcast_to(array, (lanes, *jnp.shape(array)))

    return jax.tree.map(repeated, given, mapped)


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

    def past_prism(nearest: Rays, prism: Outlines) -> Rays:
        dx, dy = prism[:, 0:1] - x, prism[:, 1:2] - y
        offsets = [(prism[:, k : k + 1], prism[:, k + 1 : k + 2]) for k in range(2, prism.shape[1], 2)]
        corners = [(dx + off_x, dy + off_y) for off_x, off_y in offsets]
        left = [ray_x * corner_y - ray_y * corner_x > 0.0 for corner_x, corner_y in corners]
        # Counter-clockwise, a ray enters by the one edge that leads from its left to its right.
        above, below = jnp.full_like(nearest, jnp.inf), jnp.ones_like(nearest)
        for k, (corner_x, corner_y) in enumerate(corners):
            after = (k + 1) % len(corners)
            along_x, along_y = offsets[after][0] - offsets[k][0], offsets[after][1] - offsets[k][1]
            enters = left[k] & ~left[after]
            above = jnp.where(enters, corner_x * along_y - corner_y * along_x, above)
            below = jnp.where(enters, ray_x * along_y - ray_y * along_x, below)
        entry = above / below
        return jnp.where((entry >= 0.0) & (entry < nearest), entry, nearest)

    nearest = jnp.full(ray_x.shape, range_m)
    most = jnp.max(_looked_at(seen, pose), axis=0)
    nearest = _past_all(past_upright, nearest, seen.upright, most[0])
    nearest = _past_all(past_turned, nearest, seen.turned, most[1])
    nearest = _past_all(past_circle, nearest, seen.circles, most[2])
    if seen.people is not None:
        nearest = functools.reduce(past_circle, jnp.moveaxis(seen.people, 1, 0), nearest)
    if seen.boxes is not None:
        nearest = functools.reduce(past_upright, jnp.moveaxis(seen.boxes, 1, 0), nearest)
    if not seen.quads.shape[1]:
        return nearest
    for prisms, count in zip(seen.kinds[_PRISMS:], most[_PRISMS:], strict=True):
        nearest = _past_all(past_prism, nearest, prisms, count, together=_PRISMS_TOGETHER)
    return nearest


def _looked_at(seen: LidarOutlines, pose: Float[Array, "lanes 3"]) -> Int[Array, "lanes 6"]:
    """Returns how many outlines of each kind each lane must look at: all, once its lidar has left what was near."""
    if seen.within is None:
        return seen.counts
    gone_m = jnp.sum((pose[:, :2] - seen.within.center_m) ** 2, axis=1, keepdims=True)
    return jnp.where(gone_m <= _ROAM_M**2, seen.within.counts, seen.counts)


def _past_all(
    past: Callable[[Rays, Outlines], Rays],
    nearest: Rays,
    outlines: Float[Array, "lanes outlines columns"],
    count: Array,
    *,
    together: int = _TOGETHER,
) -> Rays:
    """Returns the ranges after the first outlines, some at a time: sizes are multiples of that.

    Args:
        past: Returns the ranges after one more outline of each lane.
        nearest: The ranges before.
        outlines: Of all lanes.
        count: How many at least.
        together: So many at a time.
    """

    def past_some(block: Array, nearest: Rays) -> Rays:
        some = jax.lax.dynamic_slice_in_dim(outlines, block * together, together, axis=1)
        return functools.reduce(past, (some[:, k] for k in range(together)), nearest)

    return jax.lax.fori_loop(0, (count + together - 1) // together, past_some, nearest)


def _past_slabs(nearest: Rays, middle: tuple[Rays, Rays], reach: tuple[Rays, Rays]) -> Rays:
    """Returns the ranges after a box, given where each ray passes its middle and how far it is inside its slabs."""
    near_x, near_y = middle[0] - reach[0], middle[1] - reach[1]
    far_x, far_y = middle[0] + reach[0], middle[1] + reach[1]
    entry = jnp.where(near_x > near_y, near_x, near_y)
    leave = jnp.where(far_x < far_y, far_x, far_y)
    return _nearer(nearest, entry, entry <= leave)


def _nearer(nearest: Rays, entry: Rays, hit: Bool[Array, "lanes rays"]) -> Rays:
    return jnp.where(hit & (entry >= 0.0) & (entry < nearest), entry, nearest)


def divisor(part: Rays) -> Rays:
    """Returns a part of a direction to divide by: a tiny one of either sign is raised to the same above 0.

    An edge along a ray is therefore one by which it leaves: at once, or after very long.
    """
    return jnp.where(jnp.abs(part) > _TINY, part, _TINY)


def inverse(part: Rays) -> Rays:
    """Returns one by a part of a direction, also where that is 0."""
    return 1.0 / divisor(part)
