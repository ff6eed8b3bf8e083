"""Velocities that keep moving discs apart: optimal reciprocal collision avoidance, ORCA.

J. van den Berg, S. Guy, M. Lin and D. Manocha, "Reciprocal n-body collision avoidance", 2011: each neighbour leaves a
disc the velocities of a half-plane, and the one nearest to the preferred one that all half-planes leave is found by
adding them one after the other. Where nothing is left, the velocity is taken that goes beyond the half-planes of
neighbours least. Numbers of one disc become vectors over discs and lanes when the program maps them.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from tasks.simulate.geometry.lidar_scan import lanes_in_front

Scalar = Float[jax.Array, "..."]
Flag = Bool[jax.Array, "..."]
# As in RVO2, the authors' library: directions whose cross product is less are parallel.
_PARALLEL = 1e-5
_TINY = 1e-12
# So many discs at a time look for the velocity that goes beyond half-planes least.
_TOGETHER = 32


class Vector(NamedTuple):
    """A place or a velocity in the plane."""

    x: Scalar
    y: Scalar

    def dot(self, other: "Vector") -> Scalar:
        """Returns the scalar product."""
        return self.x * other.x + self.y * other.y

    def cross(self, other: "Vector") -> Scalar:
        """Returns the cross product's height: above 0 where the other one points more to the left."""
        return self.x * other.y - self.y * other.x

    def plus(self, other: "Vector", times: Scalar | float = 1.0) -> "Vector":
        """Returns the sum with so many times another one."""
        return Vector(self.x + times * other.x, self.y + times * other.y)

    def scaled(self, factor: Scalar | float) -> "Vector":
        """Returns a multiple."""
        return Vector(self.x * factor, self.y * factor)

    def unit(self) -> "Vector":
        """Returns the direction; nothing of nothing."""
        return self.scaled(1.0 / jnp.maximum(jnp.sqrt(self.dot(self)), _TINY))


def choose(condition: Flag, yes: Vector, no: Vector) -> Vector:
    """Returns one of two vectors."""
    return Vector(jnp.where(condition, yes.x, no.x), jnp.where(condition, yes.y, no.y))


class HalfPlane(NamedTuple):
    """The velocities to the left of a line, and on it.

    Attributes:
        point: On the line.
        direction: Along it, of length 1.
        there: Whether it counts at all.
    """

    point: Vector
    direction: Vector
    there: Flag

    def beyond(self, velocity: Vector) -> Scalar:
        """Returns how far a velocity is to the right of the line."""
        return self.direction.cross(self.point.plus(velocity, -1.0))


class Disc(NamedTuple):
    """A disc that moves: a person, or a robot."""

    place: Vector
    velocity: Vector
    radius_m: Scalar


def neighbour_plane(
    own: Disc, other: Disc, *, share: Scalar | float, horizon_s: float, step_s: float, there: Flag
) -> HalfPlane:
    """Returns the velocities that keep a disc clear of another one for a while, if that does its share.

    Args:
        own: The disc.
        other: Its neighbour.
        share: Of what must change, how much the disc takes upon itself: a half of another that does likewise.
        horizon_s: For how long they keep clear.
        step_s: Within what time they part, if they overlap.
        there: Whether there is a neighbour.
    """
    apart, closing = other.place.plus(own.place, -1.0), own.velocity.plus(other.velocity, -1.0)
    squared, radius_m = apart.dot(apart), own.radius_m + other.radius_m
    overlap = squared <= radius_m**2
    # Beside the round end of the velocities that collide: that of the horizon, or of this step where they overlap.
    per_s = jnp.where(overlap, 1.0 / step_s, 1.0 / horizon_s)
    off = closing.plus(apart, -per_s)
    length, ahead = jnp.sqrt(off.dot(off)), off.dot(apart)
    outward = off.unit()
    at_end = overlap | ((ahead < 0.0) & (ahead**2 > radius_m**2 * off.dot(off)))
    round_push = outward.scaled(radius_m * per_s - length)
    # Beside one of its two legs.
    leg = jnp.sqrt(jnp.maximum(squared - radius_m**2, 0.0))
    per_square = 1.0 / jnp.maximum(squared, _TINY)
    left = Vector(apart.x * leg - apart.y * radius_m, apart.x * radius_m + apart.y * leg).scaled(per_square)
    right = Vector(apart.x * leg + apart.y * radius_m, apart.y * leg - apart.x * radius_m).scaled(-per_square)
    along = choose(apart.cross(off) > 0.0, left, right)
    leg_push = along.scaled(closing.dot(along)).plus(closing, -1.0)
    push = choose(at_end, round_push, leg_push)
    direction = choose(at_end, Vector(outward.y, -outward.x), along)
    return HalfPlane(own.velocity.plus(push, share), direction, there)


def nearest_velocity(planes: Sequence[HalfPlane], fixed: int, preferred: Vector, most_m_s: Scalar) -> Vector:
    """Returns the velocity nearest to the preferred one in all half-planes, or the one least beyond those of discs.

    Args:
        planes: Those that nothing may go beyond, then those of neighbours, nearest first.
        fixed: How many of the first kind; a disc at rest is in all of them.
        preferred: Where the disc would like to go.
        most_m_s: Its top speed.
    """
    speed = jnp.sqrt(preferred.dot(preferred))
    start = preferred.scaled(jnp.minimum(1.0, most_m_s / jnp.maximum(speed, _TINY)))
    found, failed, at = _in_all(planes, most_m_s, start, preferred, straight=False)
    first = jnp.where(failed, at, len(planes))
    return _of_those_that_fail(fixed)(failed, tuple(planes), jnp.broadcast_to(most_m_s, failed.shape), found, first)


# Written out, as long as what half-planes are made of was computed before: the compiler computes again, in each of the
# operations that it makes of this, whatever no loop or division gives it.
def _in_all(
    planes: Sequence[HalfPlane], most_m_s: Scalar, start: Vector, wanted: Vector, *, straight: bool
) -> tuple[Vector, Flag, Scalar]:
    """Returns the best velocity in half-planes up to the first that leaves none, whether there is one, and its number.

    Args:
        planes: The half-planes.
        most_m_s: The top speed.
        start: The best without any half-plane.
        wanted: The velocity to come near to, or, ``straight``, the direction to go far in.
        straight: Which of them.
    """
    found, failed, at = start, jnp.zeros_like(start.x, bool), jnp.zeros_like(start.x, jnp.int32)
    for number, plane in enumerate(planes):
        best, possible = _on_line(plane, planes[:number], most_m_s, wanted, straight=straight)
        outside = plane.there & ~failed & (plane.beyond(found) > 0.0)
        found = choose(outside & possible, best, found)
        fails = outside & ~possible
        failed, at = failed | fails, jnp.where(fails, number, at)
    return found, failed, at


def _stacked(planes: Sequence[HalfPlane]) -> HalfPlane:
    return jax.tree.map(lambda *each: jnp.stack(each), *planes)


def _on_line(
    plane: HalfPlane, before: Sequence[HalfPlane], most_m_s: Scalar, wanted: Vector, *, straight: bool
) -> tuple[Vector, Flag]:
    """Returns the best velocity on a half-plane's line that others leave, and whether there is one."""
    middle = plane.point.dot(plane.direction)
    discriminant = middle**2 + most_m_s**2 - plane.point.dot(plane.point)
    half = jnp.sqrt(jnp.maximum(discriminant, 0.0))
    low, high, possible = -middle - half, -middle + half, discriminant >= 0.0
    for other in before:
        turn = plane.direction.cross(other.direction)
        over = other.direction.cross(plane.point.plus(other.point, -1.0))
        parallel = jnp.abs(turn) <= _PARALLEL
        crossing = over / jnp.where(parallel, 1.0, turn)
        crosses = other.there & ~parallel
        possible &= ~(other.there & parallel & (over < 0.0))
        high = jnp.where(crosses & (turn >= 0.0), jnp.minimum(high, crossing), high)
        low = jnp.where(crosses & (turn < 0.0), jnp.maximum(low, crossing), low)
    possible &= low <= high
    if straight:
        along = jnp.where(plane.direction.dot(wanted) > 0.0, high, low)
    else:
        along = jnp.clip(plane.direction.dot(wanted.plus(plane.point, -1.0)), low, high)
    return plane.point.plus(plane.direction, along), possible


@functools.cache
def _of_those_that_fail(fixed: int) -> Callable[..., Vector]:
    """Returns what finds the velocities least beyond half-planes, of those discs alone that need one, some at a time.

    The others, by far the most, keep theirs, bit for bit. Mapped as any function, it would do the work for all.
    """

    def of_all(fails: Flag, *given: Any) -> Vector:  # noqa: ANN401 - half-planes, top speed, velocity, first that fails
        planes, most_m_s, start, first = jax.tree.map(jnp.ravel, given)
        # How many fail up to each: so those of a block are found by halving, where a list of all takes each by itself.
        upto = jnp.cumsum(fails.ravel(), dtype=jnp.int32)

        def some(block: Scalar, found: Vector) -> Vector:
            places = jnp.searchsorted(upto, block * _TOGETHER + jnp.arange(1, _TOGETHER + 1), method="scan_unrolled")
            theirs = jax.tree.map(lambda each: each.at[places].get(mode="clip"), (planes, most_m_s, start, first))
            best = _least_beyond(fixed, *theirs)
            return jax.tree.map(lambda old, new: old.at[places].set(new, mode="drop"), found, best)

        blocks = (upto[-1] + _TOGETHER - 1) // _TOGETHER
        found = jax.lax.fori_loop(0, blocks, some, start)
        return jax.tree.map(lambda each: each.reshape(fails.shape), found)

    one = jax.custom_batching.custom_vmap(of_all)

    @one.def_vmap
    def _(lanes: int, mapped: Sequence[Any], *given: Any) -> tuple[Vector, Vector]:  # noqa: ANN401 - JAX's own form
        found = of_all(*lanes_in_front(lanes, given, tuple(mapped)))
        return found, jax.tree.map(lambda _: True, found)

    return one


def _least_beyond(fixed: int, planes: tuple[HalfPlane, ...], most_m_s: Scalar, start: Vector, first: Scalar) -> Vector:
    """Returns the velocity that goes beyond the half-planes of neighbours least, from the first that left none on."""

    def least_on(number: Scalar, plane: HalfPlane) -> tuple[Vector, Flag]:
        others = (_between(plane, other, place < number) for place, other in enumerate(planes[fixed:-1], fixed))
        inward = Vector(-plane.direction.y, plane.direction.x)
        between = [*planes[:fixed], *others]
        best, failed, _ = _in_all(between, most_m_s, inward.scaled(most_m_s), inward, straight=True)
        return best, failed

    def add(so_far: tuple[Vector, Scalar], added: tuple[Scalar, HalfPlane, tuple[Vector, Flag]]) -> tuple[Any, None]:
        (found, allowed), (number, plane, (best, failed)) = so_far, added
        worse = plane.there & (number >= first) & (plane.beyond(found) > allowed)
        found = choose(worse & ~failed, best, found)
        return (found, jnp.where(worse, plane.beyond(found), allowed)), None

    numbers, stacked = jnp.arange(fixed, len(planes), dtype=jnp.int32), _stacked(planes[fixed:])
    each = jax.vmap(least_on)(numbers, stacked)
    (found, _), _ = jax.lax.scan(add, (start, jnp.zeros_like(start.x)), (numbers, stacked, each))
    return found


def _between(plane: HalfPlane, other: HalfPlane, there: Flag) -> HalfPlane:
    """Returns the velocities that are beyond another half-plane by no more than beyond the first."""
    turn = plane.direction.cross(other.direction)
    parallel = jnp.abs(turn) <= _PARALLEL
    over = other.direction.cross(plane.point.plus(other.point, -1.0))
    crossing = plane.point.plus(plane.direction, over / jnp.where(parallel, 1.0, turn))
    middle = plane.point.plus(other.point).scaled(0.5)
    same_way = parallel & (plane.direction.dot(other.direction) > 0.0)
    direction = other.direction.plus(plane.direction, -1.0).unit()
    return HalfPlane(choose(parallel, middle, crossing), direction, there & other.there & ~same_way)
