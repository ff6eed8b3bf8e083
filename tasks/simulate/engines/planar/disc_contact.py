"""Contacts of a disc with the obstacles of its window, as the constraint rows that MuJoCo makes of them.

The window holds the nearest obstacles, as scalars relative to where the robot stands.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from specs.data.people import PERSON_HEIGHT_M, PERSON_RADIUS_M
from tasks.simulate.engines.planar.near_obstacles import Neighbours, nearest
from tasks.simulate.engines.planar.planar_algebra import Planar, Scalar
from tasks.simulate.engines.planar.planar_robot import Disc, Softness
from tasks.simulate.geometry.hull_distance import LaneObstacles, Outline, from_border, outline_of
from tasks.simulate.lane.shared_world import RobotsInputs

Flag = Bool[jax.Array, ""]


# One lane's scalars become vectors over lanes when the program maps it, so that everything downstream is elementwise
# and vectorises; arrays of one lane's obstacles would put eight numbers, not all lanes, into the innermost loop.
class Obstacle(NamedTuple):
    """A box or an upright cylinder: a rectangle grown by a radius, seen from above. Or an upright prism.

    Attributes:
        x, y: Its middle, relative to where the robot stood when the control step began.
        half_x, half_y: Of the rectangle along its own axes, of a prism along the world's; 0 for a cylinder.
        cos, sin: Of the rectangle's yaw.
        radius: Of a cylinder; 0 for a box.
        height, half_height: Of its middle above the floor, and from there to its top.
        round: Whether it is a cylinder.
        prism: Whether it is a prism; None in a program without any.
        outline: A prism's, around its middle; likewise.
        person: Whether it is a person; None in a program without people.
        robot: Whether it is another robot; None in a program whose robots are alone.
    """

    x: Scalar
    y: Scalar
    half_x: Scalar
    half_y: Scalar
    cos: Scalar
    sin: Scalar
    radius: Scalar
    height: Scalar
    half_height: Scalar
    round: Bool[jax.Array, ""]
    prism: Bool[jax.Array, ""] | None
    outline: Outline | None
    person: Bool[jax.Array, ""] | None = None
    robot: Bool[jax.Array, ""] | None = None


def window(
    obstacles: LaneObstacles, center_m: Float[jax.Array, "2"], count: int, near: Neighbours | None = None
) -> list[Obstacle]:
    """Returns the obstacles nearest to a point, seen from above, nearest first.

    Args:
        obstacles: Of the world, in the hull's band of heights.
        center_m: The point (x, y).
        count: How many, all kinds together.
        near: Those that were picked out before; None if none were.
    """
    found = nearest(obstacles, center_m, count, near)
    x, y, half_x, half_y, cos, sin, radius, height, half_height = found.columns[:9]
    return [
        Obstacle(
            x=x[k] - center_m[0],
            y=y[k] - center_m[1],
            half_x=half_x[k],
            half_y=half_y[k],
            cos=cos[k],
            sin=sin[k],
            radius=radius[k],
            height=height[k],
            half_height=half_height[k],
            round=found.round[k],
            prism=None if found.prism is None else found.prism[k],
            outline=None if found.prism is None else outline_of(found.columns[9:, k]),
        )
        for k in range(found.round.shape[0])
    ]


def with_people(
    nearest: list[Obstacle], people_m: Float[jax.Array, "people 2"], center_m: Float[jax.Array, "2"]
) -> list[Obstacle]:
    """Returns the nearest of obstacles and people, as many as there were obstacles, nearest first.

    Args:
        nearest: The obstacles nearest to a point, nearest first.
        people_m: Where people are (x, y).
        center_m: The point.
    """
    solids = [each._replace(person=jnp.zeros((), bool)) for each in nearest]
    person = _cylinder(solids[0], PERSON_RADIUS_M, PERSON_HEIGHT_M / 2, PERSON_HEIGHT_M / 2)
    person = person._replace(person=jnp.ones((), bool))
    return _nearest_of(solids, [_moved(person, place - center_m) for place in people_m])


def with_boxes(
    nearest: list[Obstacle], boxes: Float[jax.Array, "boxes 8"], center_m: Float[jax.Array, "2"]
) -> list[Obstacle]:
    """Returns the nearest of obstacles and of boxes that were put there, as ``with_people``.

    Args:
        nearest: The obstacles nearest to a point, nearest first.
        boxes: As ``LaneObstacles.boxes``.
        center_m: The point.
    """
    like = _cylinder(nearest[0], 0.0, 0.0, 0.0)._replace(round=jnp.zeros((), bool))
    put = [
        _moved(like, each[:2] - center_m)._replace(
            height=each[2], half_x=each[3], half_y=each[4], half_height=each[5], cos=each[6], sin=each[7]
        )
        for each in boxes
    ]
    return _nearest_of(nearest, put)


def with_robots(
    nearest: list[Obstacle],
    robots: RobotsInputs,
    place_m: Float[jax.Array, "robots 2"],
    center_m: Float[jax.Array, "2"],
) -> list[Obstacle]:
    """Returns the nearest of obstacles and other robots, as ``with_people``.

    Args:
        nearest: The obstacles nearest to a point, nearest first.
        robots: What the others are like.
        place_m: Where they are (x, y).
        center_m: The point.
    """
    solids = [each._replace(robot=jnp.zeros((), bool)) for each in nearest]
    height_m, half_m = (robots.low_m + robots.high_m) / 2, (robots.high_m - robots.low_m) / 2
    robot = [_cylinder(solids[0], robots.radius_m[k], height_m[k], half_m[k]) for k in range(len(place_m))]
    others = [
        _moved(each._replace(robot=jnp.ones((), bool)), place - center_m)
        for each, place in zip(robot, place_m, strict=True)
    ]
    return _nearest_of(solids, others)


def _moved(one: Obstacle, place_m: Float[jax.Array, "2"]) -> Obstacle:
    return one._replace(x=place_m[0], y=place_m[1])


def _nearest_of(solids: list[Obstacle], others: list[Obstacle]) -> list[Obstacle]:
    """Returns as many of the nearest of both as there are solids, nearest first; of equal ones the first."""
    nil = jnp.zeros_like(solids[0].x)
    apart_m = jnp.stack([distance_m([each], nil, nil) for each in (*solids, *others)])
    together: Obstacle = jax.tree.map(lambda *each: jnp.stack(each), *solids, *others)
    chosen: list[Obstacle] = []
    for _ in solids:
        first = jnp.argmin(apart_m)
        chosen.append(jax.tree.map(lambda each, at=first: each[at], together))
        apart_m = jnp.where(jnp.arange(len(apart_m)) == first, jnp.inf, apart_m)
    return chosen


def _cylinder(like: Obstacle, radius_m: Scalar | float, height_m: Scalar | float, half_m: Scalar | float) -> Obstacle:
    """Returns an upright cylinder where the control step began, with the fields that another obstacle has."""
    blank: Obstacle = jax.tree.map(jnp.zeros_like, like)
    return blank._replace(
        cos=blank.cos + 1.0,
        radius=jnp.full_like(blank.x, radius_m),
        height=jnp.full_like(blank.x, height_m),
        half_height=jnp.full_like(blank.x, half_m),
        round=jnp.ones((), bool),
    )


def distance_m(obstacles: list[Obstacle], x: Scalar, y: Scalar) -> Scalar:
    """Returns how far a point is from the nearest of the obstacles; at most 0 inside one."""
    nearest = jnp.full_like(x, jnp.inf)
    for each in obstacles:
        dx, dy = x - each.x, y - each.y
        beyond_x = jnp.maximum(jnp.abs(each.cos * dx + each.sin * dy) - each.half_x, 0.0)
        beyond_y = jnp.maximum(jnp.abs(each.cos * dy - each.sin * dx) - each.half_y, 0.0)
        apart = jnp.sqrt(beyond_x**2 + beyond_y**2) - each.radius
        if each.prism is not None and each.outline is not None:
            *_, squared, inside = from_border(each.outline, dx, dy)
            apart = jnp.where(each.prism, jnp.where(inside, 0.0, jnp.sqrt(squared)), apart)
        nearest = jnp.minimum(nearest, apart)
    return nearest


# Divisors are at least this; a point nearer than that to an obstacle's edge counts as lying on it.
_TINY_M = 1e-9
# MuJoCo picks a contact's tangents along y where the normal leans to y by less than this (mju_makeFrame).
_MUCH = 0.5


# Geometry: MuJoCo's sphere-box, sphere-cylinder, capsule-box and capsule-cylinder contacts, for spheres and upright
# capsules among boxes, cylinders and prisms that stand upright. An upright cylinder touches them where its disc does,
# which is what MuJoCo finds at flat sides; at corners its convex collider turns the normal by up to a right angle, and
# a capsule's at a prism's corners. Rows: MuJoCo documentation, chapter Computation, "Contact" and "Constraint model",
# with frictionless contacts (condim 1) and pyramidal cones (condim 3).
class Row(NamedTuple):
    """A direction in which a constraint acts: it asks that ``x ax + y ay + turn aw`` be ``target``.

    Attributes:
        turn: Its arm about the yaw axis, or None where it cannot turn the robot.
        target: MuJoCo's reference acceleration.
    """

    x: Scalar
    y: Scalar
    turn: Scalar | None
    target: Scalar


class Contact(NamedTuple):
    """A contact as constraint rows: the normal, or the normal plus and minus each tangent (a pyramid's edges).

    Attributes:
        tangents: Scaled by the friction coefficient; none for a frictionless contact.
        weight: MuJoCo's D of each row, 0 where nothing touches.
    """

    normal: Row
    tangents: list[Row]
    weight: Scalar


class Bearing(NamedTuple):
    """How a disc lies to an obstacle in height; constant while the robot moves.

    Attributes:
        rise: Vertical gap between a capsule's straight part (or a sphere's centre) and the obstacle; 0 beside it.
        cover: How far that part's end would have to move up or down to leave the obstacle's heights.
        ends_beside: Whether an end of the straight part is beside the obstacle.
        top_nearer: Whether the obstacle's upper edge is nearer to that part than its lower edge.
    """

    rise: Scalar
    cover: Scalar
    ends_beside: Flag
    top_nearer: Flag


class Touch(NamedTuple):
    """A disc and an obstacle: direction from the obstacle, slope, distance, and contacts that MuJoCo makes.

    Attributes:
        x, y: Unit vector in the plane, from the obstacle to the disc.
        level: The share of the contact's normal that lies in the plane.
        rise: The share that is vertical.
        distance: Between the surfaces (m), below 0 when pressed together.
        contacts: 1, or 2 at the same place.
    """

    x: Scalar
    y: Scalar
    level: Scalar
    rise: Scalar
    distance: Scalar
    contacts: Scalar | float


def bearing(disc: Disc, obstacle: Obstacle) -> Bearing:
    """Returns how a disc lies to an obstacle in height."""
    above = disc.height_m - obstacle.height
    low, high, half = above - disc.half_length_m, above + disc.half_length_m, obstacle.half_height
    to_top = jnp.maximum(jnp.maximum(low - half, half - high), 0.0)
    to_bottom = jnp.maximum(jnp.maximum(low + half, -half - high), 0.0)
    apart = jnp.abs(above) - disc.half_length_m - half
    return Bearing(
        rise=jnp.maximum(apart, 0.0),
        cover=-apart,
        ends_beside=(jnp.abs(low) <= half) | (jnp.abs(high) <= half),
        top_nearer=to_top < to_bottom,
    )


def touch(disc: Disc, obstacle: Obstacle, how: Bearing, x: Scalar, y: Scalar) -> Touch:
    """Returns how a disc at a place touches an obstacle.

    Args:
        disc: Of the robot.
        obstacle: In its window.
        how: How the two lie to each other.
        x: The disc's place, relative to where the control step began.
        y: Likewise.
    """
    dx, dy = x - obstacle.x, y - obstacle.y
    along, across = obstacle.cos * dx + obstacle.sin * dy, obstacle.cos * dy - obstacle.sin * dx
    past_x = along - jnp.clip(along, -obstacle.half_x, obstacle.half_x)
    past_y = across - jnp.clip(across, -obstacle.half_y, obstacle.half_y)
    squared = past_x**2 + past_y**2
    inside = squared <= 0.0
    to_x, to_y = obstacle.half_x - jnp.abs(along), obstacle.half_y - jnp.abs(across)
    by_x = to_x <= to_y
    out_x = jnp.where(inside, jnp.where(by_x, jnp.sign(along), 0.0), past_x)
    out_y = jnp.where(inside, jnp.where(by_x, 0.0, jnp.sign(across)), past_y)
    beyond = jnp.sqrt(squared)
    scale = jnp.where(inside, 1.0, 1.0 / jnp.maximum(beyond, _TINY_M))
    in_plane = jnp.where(inside, -jnp.minimum(to_x, to_y), beyond - obstacle.radius)
    out_x, out_y = (obstacle.cos * out_x - obstacle.sin * out_y), (obstacle.sin * out_x + obstacle.cos * out_y)
    if obstacle.prism is not None and obstacle.outline is not None:
        way_x, way_y, squared, inside = from_border(obstacle.outline, dx, dy)
        signed = jnp.where(inside, -jnp.sqrt(squared), jnp.sqrt(squared))
        in_plane = jnp.where(obstacle.prism, signed, in_plane)
        out_x, out_y = jnp.where(obstacle.prism, way_x, out_x), jnp.where(obstacle.prism, way_y, out_y)
        outward = jnp.where(inside, -1.0, 1.0) / jnp.maximum(jnp.abs(signed), _TINY_M)
        scale = jnp.where(obstacle.prism, outward, scale)
    level, rise, distance = _level_slope(in_plane, how, disc) if disc.flat else _slope(in_plane, how)
    return Touch(
        x=out_x * scale,
        y=out_y * scale,
        level=level,
        rise=rise,
        distance=distance - disc.radius_m,
        contacts=_contact_count(disc, obstacle, how, past_x, past_y),
    )


def contact(disc: Disc, touched: Touch, arm: tuple[Scalar, Scalar] | None, rate: Planar) -> Contact:
    """Returns a contact's constraint.

    Args:
        disc: One of the hull's.
        touched: How that disc touches an obstacle.
        arm: From the yaw axis to the disc's axis (x, y), or None where they are one.
        rate: Of the robot.
    """
    soft, excess = disc.softness, touched.distance - disc.margin_m
    impedance = _impedance(soft, excess)
    weight = touched.contacts * impedance / ((1.0 - impedance) * soft.inverse_mass)
    normal_x, normal_y = touched.x * touched.level, touched.y * touched.level
    reach = disc.radius_m + 0.5 * touched.distance
    from_x = -normal_x * reach if arm is None else arm[0] - normal_x * reach
    from_y = -normal_y * reach if arm is None else arm[1] - normal_y * reach

    def row(x: Scalar, y: Scalar, pull: Scalar | float, *, turns: bool) -> Row:
        turn = from_x * y - from_y * x if turns else None
        speed = x * rate.x + y * rate.y
        speed = speed if turn is None else speed + turn * rate.yaw
        return Row(x, y, turn, -soft.damping * speed - pull)

    rubs = disc.friction is not None
    normal = row(normal_x, normal_y, soft.stiffness * impedance * excess, turns=rubs or arm is not None)
    along = _tangents(touched, normal_y) if rubs else []
    friction = disc.friction
    tangents = (
        []
        if friction is None or is_zero(friction)
        else [row(friction * x, friction * y, 0.0, turns=True) for x, y in along]
    )
    return Contact(normal, tangents, jnp.where(excess < 0.0, weight, 0.0))


def is_zero(number: float | Scalar) -> bool:
    """Returns whether a number is known to be 0; of one that is traced nothing is known."""
    return not isinstance(number, jax.Array) and number == 0.0


def edges(contact: Contact) -> list[Row]:
    """Returns a contact's constraint rows, each of which can only push."""
    if not contact.tangents:
        return [contact.normal]
    normal = contact.normal
    return [
        jax.tree.map(lambda along, across, sign=sign: along + sign * across, normal, tangent)
        for tangent in contact.tangents
        for sign in (1.0, -1.0)
    ]


def _slope(in_plane: Scalar, how: Bearing) -> tuple[Scalar, Scalar, Scalar]:
    """Returns the shares of the normal in the plane and upright, and the distance to a sphere's or capsule's core."""
    gap = jnp.maximum(in_plane, 0.0)
    slanted = jnp.sqrt(gap**2 + how.rise**2)
    beside = how.rise <= 0.0
    scale = 1.0 / jnp.maximum(slanted, _TINY_M)
    # A core inside an obstacle, nearer to its top or bottom than to its sides, is pushed up or down: not at all.
    trapped = beside & (in_plane < -how.cover)
    level = jnp.where(beside, jnp.where(trapped, 0.0, 1.0), gap * scale)
    return level, jnp.where(beside, 0.0, how.rise * scale), jnp.where(beside, in_plane, slanted)


def _level_slope(in_plane: Scalar, how: Bearing, disc: Disc) -> tuple[Scalar, Scalar, Scalar]:
    """Returns the same for a cylinder, whose side is met beside it and whose rim above and below it.

    The distance is to its axis all the same: where the cylinder's surface is nearest, and a radius more.
    """
    gap = jnp.maximum(in_plane - disc.radius_m, 0.0)
    slanted = jnp.sqrt(gap**2 + how.rise**2)
    beside = how.rise <= 0.0
    scale = 1.0 / jnp.maximum(slanted, _TINY_M)
    # What is deeper under or over an obstacle's edge than beside it is pushed up or down: not at all.
    trapped = beside & (in_plane - disc.radius_m < -how.cover)
    level = jnp.where(beside, jnp.where(trapped, 0.0, 1.0), gap * scale)
    return level, jnp.where(beside, 0.0, how.rise * scale), jnp.where(beside, in_plane, slanted + disc.radius_m)


def _contact_count(disc: Disc, obstacle: Obstacle, how: Bearing, past_x: Scalar, past_y: Scalar) -> Scalar | float:
    """Returns how many contacts MuJoCo makes; a cylinder's side has two with a face, one above the other."""
    if disc.flat:
        return jnp.where(obstacle.round, 1.0, 2.0)
    return _capsule_contacts(disc, obstacle, how, past_x, past_y) if disc.capsule else 1.0


def _capsule_contacts(disc: Disc, obstacle: Obstacle, how: Bearing, past_x: Scalar, past_y: Scalar) -> Scalar:
    """Returns how many contacts MuJoCo makes of a capsule and a box; all lie at the same place, seen from above.

    Beside a prism there are two. Of a box, the second is left out where the capsule's nearest end points away from
    the box's nearest corner or edge by MuJoCo's reckoning, which compares their coordinates' signs in the box's frame.
    """
    lowest = (past_x <= 0.0) & (past_y <= 0.0)
    highest = (past_x >= 0.0) & (past_y >= 0.0)
    first, second = (highest, lowest) if disc.upturned else (lowest, highest)
    away = jnp.where(how.top_nearer, first, second)
    by_face = (past_x == 0.0) | (past_y == 0.0)
    single = obstacle.round | (away & ~(by_face & how.ends_beside))
    single = single if obstacle.prism is None else jnp.where(obstacle.prism, how.rise > 0.0, single)
    return jnp.where(single, 1.0, 2.0)


def _impedance(soft: Softness, excess: Scalar) -> Scalar:
    """Returns MuJoCo's d(r) of a distance beyond the margin."""
    least, most, width_m, midpoint, power = soft.impedance
    if least == most or width_m <= 1e-15:
        return jnp.full_like(excess, 0.5 * (least + most))
    depth = jnp.minimum(jnp.abs(excess) / width_m, 1.0)
    if power == 1.0:
        return least + depth * (most - least)
    # As an integer it is a product, as a float a logarithm.
    power = int(power) if power.is_integer() else power
    rising = depth**power / midpoint ** (power - 1.0)
    settling = 1.0 - (1.0 - depth) ** power / (1.0 - midpoint) ** (power - 1.0)
    return least + jnp.where(depth <= midpoint, rising, settling) * (most - least)


def _tangents(contact: Touch, normal_y: Scalar) -> list[tuple[Scalar, Scalar]]:
    """Returns what is seen from above of a contact's two tangents, as MuJoCo chooses them, signs aside."""
    by_y = jnp.abs(normal_y) < _MUCH
    cosine = jnp.sqrt(jnp.maximum(1.0 - normal_y**2, _MUCH**2))
    first_x = jnp.where(by_y, -contact.x * contact.level * normal_y / cosine, -contact.rise * contact.x)
    first_y = jnp.where(by_y, cosine, -contact.rise * contact.y)
    second_x = jnp.where(by_y, -contact.rise / cosine, contact.y)
    second_y = jnp.where(by_y, 0.0, -contact.x)
    return [(first_x, first_y), (second_x, second_y)]
