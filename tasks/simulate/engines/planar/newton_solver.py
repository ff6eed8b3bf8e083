"""The acceleration that MuJoCo's soft constraints leave to a planar base: Newton's method on three unknowns.

Minimised is 1/2 (a - a0)' M (a - a0) plus a quadratic in each row's violation (Gauss's principle; MuJoCo documentation,
chapter Computation, "Constraint model", primal problem). It is convex and piecewise quadratic: a Newton step is exact
unless it changes which rows push. In heavy contact 84 to 97 problems in 100 are solved by the first step. Full steps
may also jump back and forth for ever (one problem in 10,000 with contacts alone, one in 100 with dry friction of
joints), so from the third step on a step that went too far is followed by a search along it.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Int

from tasks.simulate.engines.planar.disc_contact import Contact, Row, edges
from tasks.simulate.engines.planar.planar_algebra import Planar, Scalar, Symmetric, dot, plus, solved, times
from tasks.simulate.engines.planar.planar_robot import DryFriction

Flag = Bool[jax.Array, ""]
Count = Int[jax.Array, ""]
# The longest of 24,000 searches took 13 steps.
_MOST_STEPS = 24
_FULL_STEPS = 2
# A step is long enough, and not too long, where the slope along it is within this share of the slope at its start.
_LOOSENESS = 0.3
# A new point of a search keeps at least this share of the bracket on either side.
_EDGE = 0.05
_STILL = 1e-5


class _Search(NamedTuple):
    """Where the method stands.

    Attributes:
        at: The point found so far: ``base`` plus ``share`` of ``way``.
        base, way: Where the last Newton step began, and that step in full.
        drop: The slope along the way at its beginning.
        share, low, high: Of the way: where ``at`` is, and what brackets the minimum; ``high`` is 0 before it is known.
        moving: Whether the last step moved the point.
        steps: How many were taken.
    """

    at: Planar
    base: Planar
    way: Planar
    drop: Scalar
    share: Scalar
    low: Scalar
    high: Scalar
    moving: Flag
    steps: Count


def minimizer(
    mass: Symmetric, force: Planar, contacts: list[Contact], dry: list[tuple[DryFriction, Scalar]], start: Planar
) -> Planar:
    """Returns the constrained acceleration.

    Args:
        mass: The mass matrix.
        force: What acts on the robot besides constraints.
        contacts: Each with rows that can only push.
        dry: Joints with dry friction, each with its reference acceleration.
        start: A guess, such as the acceleration of the step before.
    """

    def step(search: _Search) -> _Search:
        slope, curvature = _derivatives(mass, force, contacts, dry, search.at)
        full = _full_step(search, slope, curvature)
        along = dot(slope, search.way)
        enough = _LOOSENESS * jnp.abs(search.drop)
        too_far, too_near = along > enough, (along < -enough) & (search.high > 0.0)
        part = _part_step(search, along, dot(search.way, times(curvature, search.way)), too_far)
        full = full._replace(moving=full.moving & _changed(contacts, dry, search.at, full.at))
        searching = (search.steps >= _FULL_STEPS) & (too_far | too_near)
        return jax.tree.map(lambda yes, no: jnp.where(searching, yes, no), part, full)

    nil = jnp.zeros_like(start.x)
    still = Planar(nil, nil, nil)
    begin = _Search(start, start, still, nil, nil, nil, nil, jnp.ones((), bool), jnp.zeros((), jnp.int32))
    return jax.lax.while_loop(lambda search: search.moving & (search.steps < _MOST_STEPS), step, begin).at


def contact_force(contacts: list[Contact], acceleration: Planar) -> tuple[Scalar, Scalar]:
    """Returns what the contacts push with along x and y."""
    x = y = jnp.zeros_like(acceleration.x)
    for row, weight in _pushing(contacts):
        strength = -weight * jnp.minimum(_violation(row, acceleration), 0.0)
        x, y = x + row.x * strength, y + row.y * strength
    return x, y


def _pushing(contacts: list[Contact]) -> list[tuple[Row, Scalar]]:
    return [(row, contact.weight) for contact in contacts for row in edges(contact)]


def _full_step(search: _Search, slope: Planar, curvature: Symmetric) -> _Search:
    """Returns the search after a Newton step."""
    back = solved(curvature, slope)
    way = Planar(-back.x, -back.y, -back.yaw)
    at, nil = plus(search.at, way), jnp.zeros_like(slope.x)
    moving = _size(way) > _STILL * (1.0 + _size(at))
    return _Search(at, search.at, way, dot(slope, way), nil + 1.0, nil, nil, moving, search.steps + 1)


def _part_step(search: _Search, along: Scalar, bend: Scalar, too_far: Flag) -> _Search:
    """Returns the search after Newton's step along the last way, or a bisection where that leaves the bracket."""
    low, high = jnp.where(too_far, search.low, search.share), jnp.where(too_far, search.share, search.high)
    middle, width, guess = 0.5 * (low + high), high - low, search.share - along / bend
    share = jnp.where(jnp.abs(guess - middle) < (0.5 - _EDGE) * width, guess, middle)
    at = plus(search.base, search.way, share)
    moving = width * _size(search.way) > _STILL * (1.0 + _size(at))
    return _Search(at, search.base, search.way, search.drop, share, low, high, moving, search.steps + 1)


def _derivatives(
    mass: Symmetric, force: Planar, contacts: list[Contact], dry: list[tuple[DryFriction, Scalar]], at: Planar
) -> tuple[Planar, Symmetric]:
    """Returns gradient and Hessian of what is minimised."""
    slope = [moved - acting for moved, acting in zip(times(mass, at), force, strict=True)]
    xx, xy, xw, yy, yw, ww = mass
    for row, stiffness in _pushing(contacts):
        violation = _violation(row, at)
        weight = jnp.where(violation < 0.0, stiffness, 0.0)
        pull, weight_x, weight_y = weight * violation, weight * row.x, weight * row.y
        slope[0], slope[1] = slope[0] + row.x * pull, slope[1] + row.y * pull
        xx, xy, yy = xx + weight_x * row.x, xy + weight_x * row.y, yy + weight_y * row.y
        if row.turn is not None:
            slope[2] = slope[2] + row.turn * pull
            xw, yw, ww = xw + weight_x * row.turn, yw + weight_y * row.turn, ww + weight * row.turn**2
    curvature = [xx, yy, ww]
    for friction, target in dry:
        pull = friction.weight * (at[friction.axis] - target)
        slope[friction.axis] = slope[friction.axis] + jnp.clip(pull, -friction.limit, friction.limit)
        stiff = jnp.where(jnp.abs(pull) < friction.limit, friction.weight, 0.0)
        curvature[friction.axis] = curvature[friction.axis] + stiff
    return Planar(*slope), Symmetric(curvature[0], xy, xw, curvature[1], yw, curvature[2])


def _changed(contacts: list[Contact], dry: list[tuple[DryFriction, Scalar]], before: Planar, after: Planar) -> Flag:
    """Returns whether two accelerations have other rows pushing, or other joints slipping."""
    changed = jnp.zeros_like(before.x, bool)
    for row, weight in _pushing(contacts):
        differs = (_violation(row, before) < 0.0) != (_violation(row, after) < 0.0)
        changed |= differs & (weight > 0.0)
    for friction, target in dry:
        slips = [friction.weight * (each[friction.axis] - target) / friction.limit for each in (before, after)]
        # -1, 0 or 1: slipping one way, held, slipping the other way.
        kept = [jnp.trunc(jnp.clip(each, -1.0, 1.0)) for each in slips]
        changed |= kept[0] != kept[1]
    return changed


def _violation(row: Row, at: Planar) -> Scalar:
    violation = row.x * at.x + row.y * at.y - row.target
    return violation if row.turn is None else violation + row.turn * at.yaw


def _size(vector: Planar) -> Scalar:
    return jnp.abs(vector.x) + jnp.abs(vector.y) + jnp.abs(vector.yaw)
