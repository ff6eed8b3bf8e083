"""The obstacles that a robot may touch: few are picked out, and the physics looks at as few of them as the lanes need.

The nearest obstacles are asked for at each control step, and a robot moves by less than a metre in a slice. Few can be
among the nearest anywhere in a disc around it, and the nearest of those are the nearest of all, in the same order. A
robot that has left its disc is looked up among all again (docs/decisions/0043).

How many of the nearest a physics step looks at is decided while running. A branch on one lane's number, mapped over
lanes, would do the work of both sides; so the number of the lane that needs most decides for all.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from tasks.simulate.devices import rounds_each_operation
from tasks.simulate.engines.planar.planar_algebra import Planar, Scalar
from tasks.simulate.geometry.hull_distance import (
    Boxes,
    Cylinders,
    LaneObstacles,
    Prisms,
    to_boxes_m,
    to_cylinders_m,
    to_obstacles_m,
    to_outlines_m,
)
from tasks.simulate.geometry.lidar_scan import lanes_in_front

_NEVER = 2**31 - 1
# A disc is as large as the slots allow: the first is what a courier drives in a slice.
_RADII_M = (0.8, 0.6, 0.4)
# As many as this, or a share of the world's. More take time at each step, fewer make discs small in clutter.
_SLOTS, _SHARE = 64, 6
# For what single precision rounds of distances, and of coordinates.
_LEAST_M, _OF_COORDINATES = 1e-3, 4e-6
_GROUPS, _TOGETHER = 32, 128
_ROW = 16
# Places of so many obstacles: as many bits whatever fills a world up, or rows would hang on the worlds beside it.
_PLACE_BITS = 12
# Of an obstacle: (x, y, half x, half y, cos yaw, sin yaw, radius, z, half z), as in Obstacle of the window; where there
# are prisms, the corners follow, and a prism is as large as the upright box around it.
Columns = Float[Array, "columns obstacles"]


class Neighbours(NamedTuple):
    """Obstacles that can be among the nearest ones while a robot is in a disc.

    Attributes:
        center_m: The disc's (x, y).
        radius_m: Below 0 if there is none: too many obstacles are near.
        columns: Of the obstacles, boxes first, then cylinders, then prisms, each kind in the world's order.
        round: Which are cylinders.
        prism: Which are prisms; None in a program without any.
        used: Which places hold one.
    """

    center_m: Float[Array, "2"]
    radius_m: Float[Array, ""]
    columns: Columns
    round: Bool[Array, "obstacles"]
    prism: Bool[Array, "obstacles"] | None
    used: Bool[Array, "obstacles"]


class Nearest(NamedTuple):
    """The obstacles nearest to a point, nearest first.

    Attributes:
        columns: Of them.
        round: Which are cylinders.
        prism: Which are prisms; None in a program without any.
    """

    columns: Columns
    round: Bool[Array, "obstacles"]
    prism: Bool[Array, "obstacles"] | None


def neighbours(obstacles: LaneObstacles, center_m: Float[Array, "2"], count: int) -> Neighbours:
    """Returns the obstacles that can be among the nearest ones around a point.

    One that is left out is farther from the point than ``count`` others by more than the disc's diameter.

    Args:
        obstacles: Of the world, in the hull's band of heights.
        center_m: The point (x, y).
        count: How many nearest ones will be asked for.
    """
    apart_m, total = jnp.maximum(_apart_m(obstacles, center_m), 0.0), _total(obstacles)
    slots = max(_SLOTS, total // _SHARE)
    extents_m = sum((_extent_m(kind) for kind in obstacles if len(kind)), start=jnp.abs(center_m).sum())
    rounded_m = _LEAST_M + _OF_COORDINATES * extents_m
    # A place is written into the last bits of a distance, which is less by that.
    share = 2.0 ** (_place_bits(total) - 22)
    enough_m = _at_least_m(apart_m, count) + rounded_m
    radii_m = jnp.array(_RADII_M)
    limits_m = (enough_m + 2.0 * radii_m) * (1.0 + share)
    fits = (apart_m <= limits_m[:, None]).sum(axis=1, dtype=jnp.int32) <= slots
    chosen = jnp.argmax(fits)
    places = _first(apart_m <= limits_m[chosen], slots)
    radius_m = jnp.where(fits.any(), radii_m[chosen], -1.0)
    return Neighbours(center_m, radius_m, *_picked(obstacles, places), used=places < total)


def nearest(obstacles: LaneObstacles, center_m: Float[Array, "2"], count: int, near: Neighbours | None) -> Nearest:
    """Returns the obstacles nearest to a point.

    Args:
        obstacles: Of the world.
        center_m: The point (x, y).
        count: How many.
        near: Those that were picked out before; None if none were.
    """
    most = min(count, _total(obstacles))
    if near is None:
        return _of_all(most, obstacles, center_m)
    return _of_lane(most)(obstacles, center_m, near)


@functools.cache
def _of_lane(count: int) -> Callable[..., Nearest]:
    """Returns the function of a lane; mapped, it looks at all obstacles if any lane must, since a branch costs both."""

    def of_lanes(obstacles: LaneObstacles, center_m: Array, near: Neighbours) -> Nearest:
        away_m = center_m - near.center_m
        inside = (jnp.sum(away_m**2, axis=-1) <= near.radius_m**2) & (near.radius_m > 0.0)

        def of_near(obstacles: LaneObstacles, center_m: Array, near: Neighbours) -> Nearest:
            return jax.vmap(functools.partial(_of_near, count))(obstacles, center_m, near)

        def of_all(obstacles: LaneObstacles, center_m: Array, _: Neighbours) -> Nearest:
            return jax.vmap(functools.partial(_of_all, count))(obstacles, center_m)

        return jax.lax.cond(inside.all(), of_near, of_all, obstacles, center_m, near)

    @jax.custom_batching.custom_vmap
    def one(obstacles: LaneObstacles, center_m: Array, near: Neighbours) -> Nearest:
        lanes = jax.tree.map(lambda array: array[None], (obstacles, center_m, near))
        return jax.tree.map(lambda array: array[0], of_lanes(*lanes))

    @one.def_vmap
    def _(lanes: int, mapped: Sequence[Any], *given: Any) -> tuple[Nearest, Nearest]:  # noqa: ANN401 - JAX's own form
        found = of_lanes(*lanes_in_front(lanes, given, tuple(mapped)))
        return found, jax.tree.map(lambda _: True, found)

    return one


def _of_all(count: int, obstacles: LaneObstacles, center_m: Float[Array, "2"]) -> Nearest:
    places = _smallest(_apart_m(obstacles, center_m), count, _total(obstacles), None)
    return _picked(obstacles, places)


def _picked(obstacles: LaneObstacles, places: Int[Array, "places"]) -> Nearest:
    """Returns the obstacles at places; of a world's many, the columns of few are made."""
    firsts = np.cumsum([0, *map(len, obstacles)])
    chosen = [
        kind[jnp.clip(places - int(first), 0, len(kind) - 1)] if len(kind) else kind
        for kind, first in zip(obstacles, firsts, strict=False)
    ]
    found, kinds = _columns(LaneObstacles(*chosen)), _kinds(obstacles, places)
    columns = jnp.where(kinds["round"], found[1], found[0])
    if kinds["prism"] is not None:
        columns = jnp.where(kinds["prism"], found[2], columns)
    return Nearest(columns, **kinds)


def _of_near(count: int, obstacles: LaneObstacles, center_m: Float[Array, "2"], near: Neighbours) -> Nearest:
    x, y, half_x, half_y, cos, sin, radius, z, half_z, *corners = near.columns
    as_boxes = to_boxes_m(jnp.stack([x, y, z, half_x, half_y, half_z, cos, sin], axis=1), center_m)
    as_cylinders = to_cylinders_m(jnp.stack([x, y, z, radius, half_z], axis=1), center_m)
    distances = jnp.where(near.round, as_cylinders, as_boxes)
    if near.prism is not None:
        as_prisms = to_outlines_m(corners, center_m[0] - x, center_m[1] - y)
        distances = jnp.where(near.prism, as_prisms, distances)
    # These are in the order of all, so that equal distances stand in the same order.
    chosen = _smallest(distances, count, _total(obstacles), near.used)
    prism = None if near.prism is None else near.prism[chosen]
    return Nearest(near.columns[:, chosen], near.round[chosen], prism)


def _total(obstacles: LaneObstacles) -> int:
    return sum(map(len, obstacles))


def _apart_m(obstacles: LaneObstacles, center_m: Float[Array, "2"]) -> Float[Array, "obstacles"]:
    return jnp.concatenate(to_obstacles_m(obstacles, center_m))


def _kinds(obstacles: LaneObstacles, places: Int[Array, "places"]) -> dict[str, Any]:
    """Returns which places hold a cylinder, and which a prism."""
    boxes, cylinders, prisms = map(len, obstacles)
    if not prisms:
        return {"round": places >= boxes, "prism": None}
    is_prism = places >= boxes + cylinders
    return {"round": (places >= boxes) & ~is_prism, "prism": is_prism}


def _smallest(
    distances: Float[Array, "obstacles"], count: int, total: int, used: Bool[Array, "obstacles"] | None
) -> Int[Array, "nearest"]:
    """Returns the places of the smallest distances.

    A place is written into the last bits of its distance (as integers, floats from 0 up sort as they do), so that each
    round is one minimum over whole vectors; ``top_k`` takes six times as long as all of a control step's physics.
    Distances that differ by less than a 2,000th of themselves stand in the order of places.

    Args:
        distances: Of the obstacles.
        count: How many.
        total: Of the world, also if these are some of them: as many bits hold a place. They are the same up to 4,096.
        used: Which are none; None if all are.
    """
    place_mask = (1 << _place_bits(total)) - 1
    ordered = jax.lax.bitcast_convert_type(jnp.maximum(distances, 0.0), jnp.int32)
    keys = (ordered & ~place_mask) | jnp.arange(distances.shape[0], dtype=jnp.int32)
    keys = keys if used is None else jnp.where(used, keys, _NEVER)
    chosen: list[Int[Array, ""]] = []
    last = jnp.int32(-1)
    for _ in range(count):
        last = _least(jnp.where(keys > last, keys, _NEVER))
        chosen.append(last & place_mask)
    return jnp.stack(chosen)


def _least(keys: Int[Array, "keys"]) -> Int[Array, ""]:
    """Returns the least key. Halves are compared as vectors first; a minimum along a row takes one key at a time."""
    while len(keys) > _ROW and len(keys) % 2 == 0:
        keys = jnp.minimum(keys[: len(keys) // 2], keys[len(keys) // 2 :])
    return jnp.min(keys)


def _place_bits(total: int) -> int:
    return max(_PLACE_BITS, (total - 1).bit_length())


def _extent_m(shapes: Boxes | Cylinders | Prisms) -> Float[Array, ""]:
    """Returns more than any coordinate or size of obstacles of a kind."""
    return jnp.abs(shapes).max(axis=0).sum()


def _at_least_m(apart_m: Float[Array, "obstacles"], count: int) -> Float[Array, ""]:
    """Returns a distance within which so many obstacles are: of so many groups' nearest ones, the farthest."""
    filled_m = jnp.concatenate([apart_m, jnp.full(-len(apart_m) % _GROUPS, jnp.inf)]).reshape(-1, _GROUPS)
    least_m = filled_m.min(axis=0)
    return jax.lax.fori_loop(0, count, lambda _, last: jnp.min(jnp.where(least_m > last, least_m, jnp.inf)), -1.0)


def _first(kept: Bool[Array, "obstacles"], most: int) -> Int[Array, "most"]:
    """Returns the places of what is kept, in order, at most so many; the number of all for a slot that is not used.

    How many are kept before each is a product with a triangle of ones: sums one after the other take ten times as long.
    """
    together = min(_TOGETHER, len(kept))
    parts = jnp.concatenate([kept, jnp.zeros(-len(kept) % together, bool)]).reshape(-1, together)
    before = parts.astype(jnp.float32) @ np.triu(np.ones((together, together), np.float32), 1)
    totals = parts.sum(axis=1, dtype=jnp.int32)
    rank = (before.astype(jnp.int32) + (jnp.cumsum(totals) - totals)[:, None]).reshape(-1)[: len(kept)]
    places = jnp.arange(len(kept), dtype=jnp.int32)
    return jnp.full(most, len(kept), jnp.int32).at[jnp.where(kept, rank, most)].set(places, mode="drop")


def _columns(obstacles: LaneObstacles) -> list[Columns]:
    """Returns the columns of each kind of obstacles that there is."""
    boxes, cylinders, prisms = obstacles
    if not len(prisms):
        return [_of_boxes(boxes), _of_cylinders(cylinders)]
    found = [_of_boxes(boxes), _of_cylinders(cylinders), _of_prisms(prisms)]
    rows = max(map(len, found))
    return [jnp.concatenate([each, jnp.zeros((rows - len(each), each.shape[1]))]) for each in found]


def _of_boxes(boxes: Boxes) -> Columns:
    x, y, z, half_x, half_y, half_z, cos, sin = boxes.T
    return jnp.stack([x, y, half_x, half_y, cos, sin, jnp.zeros_like(x), z, half_z])


def _of_cylinders(cylinders: Cylinders) -> Columns:
    x, y, z, radius, half_z = cylinders.T
    nil = jnp.zeros_like(x)
    return jnp.stack([x, y, nil, nil, nil + 1.0, nil, radius, z, half_z])


def _of_prisms(prisms: Prisms) -> Columns:
    x, y, z, half_z, *corners = prisms.T
    nil = jnp.zeros_like(x)
    half_x, half_y = (jnp.abs(jnp.stack(corners[axis::2])).max(axis=0) for axis in (0, 1))
    return jnp.stack([x, y, half_x, half_y, nil + 1.0, nil, nil, z, half_z, *corners])


# A physics step is compiled for as many obstacles as this, and for all in the window.
FEW = (0, 1, 3)
# Any tree of arrays of a lane.
Tree = Any


def among_fewest(work: Callable[[int, Tree], Tree], counts: Sequence[int]) -> Callable[[Int[Array, ""], Tree], Tree]:
    """Returns a function of how many obstacles a lane needs, and of what it is given.

    Args:
        work: What is done with the first so many obstacles; it must give the same with more of them than are needed.
        counts: The numbers that it is compiled for, ascending; a lane needs at most the last one.
    """

    def of_lanes(most: Int[Array, "lanes"], given: Tree) -> Tree:
        steps = [jax.vmap(lambda each, count=count: work(count, each)) for count in counts]
        return jax.lax.switch((jnp.array(counts) < most.max()).sum(dtype=jnp.int32), steps, given)

    @jax.custom_batching.custom_vmap
    def one(most: Int[Array, ""], given: Tree) -> Tree:
        lanes = jax.tree.map(lambda array: array[None], (most, given))
        return jax.tree.map(lambda array: array[0], of_lanes(*lanes))

    @one.def_vmap
    def _(lanes: int, mapped: Sequence[Any], *given: Any) -> tuple[Tree, Tree]:  # noqa: ANN401 - JAX's own form
        found = of_lanes(*lanes_in_front(lanes, given, tuple(mapped)))
        return found, jax.tree.map(lambda _: True, found)

    return one


def few_counts(total: int) -> tuple[int, ...]:
    """Returns how many of a window's obstacles work is compiled for.

    Only all of them where programs may fuse products and sums: each count has its own rounding there, and a lane's last
    bits would hang on its neighbours.

    Args:
        total: In the window.
    """
    return (*(each for each in FEW if each < total), total) if rounds_each_operation() else (total,)


def obstacles_needed(free_m: Sequence[Scalar], moved: Planar, before: Planar) -> Int[Array, ""]:
    """Returns how many of the obstacles must be looked at so that no other can push.

    What does not push adds zeros to what the solver sums up. They change nothing, but for the sign of an acceleration
    that is -0 already: then all obstacles are needed.

    Args:
        free_m: How far the robot can go from where the control step began, and not touch each obstacle.
        moved: How far it went.
        before: Its acceleration in the physics step before.
    """
    gone_m = jnp.sqrt(moved.x**2 + moved.y**2)
    count = jnp.int32(0)
    for place, each in enumerate(free_m, 1):
        count = jnp.where(gone_m < each, count, place)
    negative = [(part == 0.0) & jnp.signbit(part) for part in before]
    return jnp.where(negative[0] | negative[1] | negative[2], len(free_m), count)
