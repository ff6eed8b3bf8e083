"""Vectors and matrices over a planar base's three degrees of freedom, entry by entry.

Entries are scalars of one lane, so that mapping over lanes makes each of them one vector; a 3x3 array of each lane
would put three numbers into the innermost loop.
"""

from typing import NamedTuple

import jax
from jaxtyping import Float

Scalar = Float[jax.Array, ""]


class Planar(NamedTuple):
    """Along x, along y and about the yaw axis: a place, rates, or forces."""

    x: Scalar
    y: Scalar
    yaw: Scalar


class Moving(NamedTuple):
    """Where a robot is, where it heads (cosine and sine of its yaw), and how it moves."""

    place: Planar
    cos: Scalar
    sin: Scalar
    rate: Planar

    def turned(self, forward: Scalar | float, left: Scalar | float) -> tuple[Scalar, Scalar]:
        """Returns a vector of the base's frame along the world's axes."""
        return self.cos * forward - self.sin * left, self.sin * forward + self.cos * left


class Symmetric(NamedTuple):
    """A symmetric matrix; w is the yaw."""

    xx: Scalar
    xy: Scalar
    xw: Scalar
    yy: Scalar
    yw: Scalar
    ww: Scalar


def plus(one: Planar, other: Planar, scale: Scalar | float = 1.0) -> Planar:
    """Returns one vector plus a scaled other."""
    return Planar(one.x + scale * other.x, one.y + scale * other.y, one.yaw + scale * other.yaw)


def dot(one: Planar, other: Planar) -> Scalar:
    """Returns the inner product."""
    return one.x * other.x + one.y * other.y + one.yaw * other.yaw


def plus_square(matrix: Symmetric, vector: Planar, scale: Scalar | float) -> Symmetric:
    """Returns a matrix plus a scaled vector's product with itself."""
    x, y, w = scale * vector.x, scale * vector.y, scale * vector.yaw
    return Symmetric(
        matrix.xx + x * vector.x,
        matrix.xy + x * vector.y,
        matrix.xw + x * vector.yaw,
        matrix.yy + y * vector.y,
        matrix.yw + y * vector.yaw,
        matrix.ww + w * vector.yaw,
    )


def times(matrix: Symmetric, vector: Planar) -> Planar:
    """Returns a matrix times a vector."""
    return Planar(
        matrix.xx * vector.x + matrix.xy * vector.y + matrix.xw * vector.yaw,
        matrix.xy * vector.x + matrix.yy * vector.y + matrix.yw * vector.yaw,
        matrix.xw * vector.x + matrix.yw * vector.y + matrix.ww * vector.yaw,
    )


def solved(matrix: Symmetric, right: Planar) -> Planar:
    """Returns the solution of a positive definite system (LDL')."""
    by_xx = 1.0 / matrix.xx
    low_y, low_w = matrix.xy * by_xx, matrix.xw * by_xx
    by_y = 1.0 / (matrix.yy - low_y * matrix.xy)
    cross = matrix.yw - low_y * matrix.xw
    across = cross * by_y
    pivot_w = matrix.ww - low_w * matrix.xw - across * cross
    y = right.y - low_y * right.x
    w = (right.yaw - low_w * right.x - across * y) / pivot_w
    y = y * by_y - across * w
    return Planar(right.x * by_xx - low_y * y - low_w * w, y, w)
