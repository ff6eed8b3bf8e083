"""Gives way to whoever walks about: to what the lidar sees where the map has nothing.

The ends of rays that are on no solid of the map lie on people. Those near each other are one person, which is followed
from scan to scan, and is taken to walk on as it walks. The robot goes on as planned while that keeps it clear of all of
them for the next seconds. Else it tries directions and paces, standing and backing off among them, and takes the one
that keeps off people, stays on free floor and still leads on (the dynamic window of Fox, Burgard and Thrun, 1997, over
straight ways and moving obstacles).

Without anybody it costs a look at the map for each ray, and changes no bit of what the robot does.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from .planning import RADIUS_M, cell_of
from .scan import Lidar, ends_of, free_ahead, free_behind

if TYPE_CHECKING:
    from tasks.simulate.application.contract import FloorMap

# The map's clearances in steps of a centimetre, as far as a byte goes.
_UNIT_M = 0.01
_MOST_UNITS = 255
# An end so far from every solid is on none: the map may be off by a cell, and a believed pose by some centimetres.
_OFF_MAP_M = 0.15
_CELLS_OFF = 1.5
# So many of the nearest people are followed; half of a person's width, and which ends are of the same one.
_FOLLOWED = 3
_PERSON_M = 0.25
_SAME_M = 0.38
# A shorter chord between two ends says little of where the middle is.
_CHORD_M = 0.12
# A person who was seen is looked for so far from where it should be, and believed in for so many scans without.
_AGAIN_M = 0.5
_BELIEVED = 10
# How much of what a scan says anew is believed of the place, and of the velocity: less where one end alone is seen.
_PLACE_GAIN, _SPEED_GAIN, _GUESSED_GAIN = 0.5, 0.2, 0.08
_TOP_SPEED_M_S = 2.0
_CONTROL_S = 0.05
# Directions and paces that are tried, and for how long ahead.
_DIRECTIONS, _PACES = 16, (0.5, 1.0)
_AHEAD_S, _LOOKS = 2.0, 10
# The gap to people that is wished now, and how much more for each second ahead.
_GAP_M, _UNSURE_M_S = 0.35, 0.1
_TOUCH_M = 0.03
_WALL_M = RADIUS_M + 0.03
# On a way to a wall it must be able to stop, so only this much of it has to be free.
_FREE_S = 1.2
# Deceleration to plan on, how fast it turns towards a way, and how much nearer than its range a ray saw something.
_BRAKE_M_S2, _TURN_GAIN, _NOTHING_M = 0.8, 3.0, 0.1
# Turning on the spot takes its time; backwards it drives at once.
_QUICK_TURN_RAD, _TURN_RAD_S = 0.4, 2.5
_BACK_RAD = 1.9
# What counts how much: nearness, a touch, getting on, leaving the heading, and keeping to the way chosen before.
_NEAR, _HIT, _ON, _SWERVE, _KEEP = 6.0, 6.0, 0.6, 0.05, 0.8
# With people before it the robot is no faster than this, and so much more for a metre of gap.
_CALM_M_S, _CALM_PER_M = 0.12, 0.5
_BEFORE = 0.7
_FAR_M = 1e3
Point = Float[jax.Array, "2"]


class People(NamedTuple):
    """Who was seen; a slot with nobody has been empty for longer than anybody is believed in.

    Attributes:
        place_m, velocity: Of each, in the map's frame.
        unseen: For how many scans.
        heading: The direction that the robot chose at the last step; none where it went on as planned.
    """

    place_m: Float[jax.Array, "people 2"]
    velocity: Float[jax.Array, "people 2"]
    unseen: Int[jax.Array, "people"]
    heading: Point


class Room(NamedTuple):
    """The map's clearances, small enough to keep."""

    units: UInt8[jax.Array, "rows columns"]
    origin_m: Point
    cell_m: Float[jax.Array, ""]


class Planned(NamedTuple):
    """What the robot would do by itself.

    Attributes:
        control: Forward (m/s), turn (rad/s), sideways (m/s).
        turn_rad: Where its way leads, from where it looks.
        target_m: The next point of it.
        most_m_s: Its speed limit.
    """

    control: Float[jax.Array, "3"]
    turn_rad: Float[jax.Array, ""]
    target_m: Point
    most_m_s: Float[jax.Array, ""]


def nobody() -> People:
    """Returns the people of a robot that has seen none."""
    none = jnp.zeros((_FOLLOWED, 2))
    return People(none + _FAR_M, none, jnp.full(_FOLLOWED, _BELIEVED + 1, jnp.int32), jnp.zeros(2))


def room_of(floor: "FloorMap") -> Room:
    """Returns what is kept of a map."""
    units = jnp.clip(floor.clearance_m / _UNIT_M, 0.0, _MOST_UNITS).astype(jnp.uint8)
    return Room(units, floor.origin_m, floor.cell_m)


def give_way(
    people: People,
    room: Room,
    pose: Float[jax.Array, "3"],
    ranges_m: Float[jax.Array, "rays"],
    planned: Planned,
) -> tuple[People, Float[jax.Array, "3"]]:
    """Returns the people that are known after a scan, and the control among them: as planned without any.

    Args:
        people: Known before.
        room: The map's.
        pose: Of the robot, as it believes.
        ranges_m: Of the scan.
        planned: Without people.
    """
    off_m = jnp.maximum(_OFF_MAP_M, _CELLS_OFF * room.cell_m)
    strange = (ranges_m < Lidar().range_m - _NOTHING_M) & (_room_m(room, ends_of(pose, ranges_m)) > off_m)
    return _among_people(people, room, pose, ranges_m, strange, planned)


Known = tuple[People, Float[jax.Array, "3"]]


@jax.custom_batching.custom_vmap
def _among_people(  # noqa: PLR0917 - as it is mapped
    people: People,
    room: Room,
    pose: jax.Array,
    ranges_m: jax.Array,
    strange: jax.Array,
    planned: Planned,
) -> Known:
    people = _followed(people, pose[:2], _people_in(ends_of(pose, ranges_m), strange, pose[:2]))
    return _controlled(people, room, pose, ranges_m, planned)


@_among_people.def_vmap
def _among_people_of_lanes(lanes: int, mapped: Sequence[object], *given: object) -> tuple[Known, Known]:
    """Returns the same of many robots; where none of them knows of anybody, nothing is computed."""

    def repeated(array: jax.Array, is_mapped: bool) -> jax.Array:  # noqa: FBT001 - JAX's own form
        return array if is_mapped else jnp.broadcast_to(array, (lanes, *jnp.shape(array)))

    each = jax.tree.map(repeated, tuple(given), tuple(mapped))
    people, _, _, _, strange, planned = each
    anybody = jnp.any(strange) | jnp.any(people.unseen <= _BELIEVED)
    found = jax.lax.cond(anybody, lambda: jax.vmap(_among_people.fun)(*each), lambda: (people, planned.control))
    return found, jax.tree.map(lambda _: True, found)


class Seen(NamedTuple):
    """The nearest people in a scan.

    Attributes:
        end_m: The nearest end on each.
        middle_m: Where its middle is: of the circle through its outermost ends, if they are apart; else behind it.
        sure: Whether they are.
        there: Whether there is anybody.
    """

    end_m: Float[jax.Array, "people 2"]
    middle_m: Float[jax.Array, "people 2"]
    sure: Bool[jax.Array, "people"]
    there: Bool[jax.Array, "people"]


def _people_in(ends_m: Float[jax.Array, "rays 2"], strange: Bool[jax.Array, "rays"], place_m: Point) -> Seen:
    """Returns the nearest people in a scan, given which ends lie on people."""
    found: list[Seen] = []
    away_m = _length(ends_m - place_m)
    for _ in range(_FOLLOWED):
        first_m = ends_m[jnp.argmin(jnp.where(strange, away_m, _FAR_M))]
        apart_m = _length(ends_m - first_m)
        own = strange & (apart_m < _SAME_M)
        chord = ends_m[jnp.argmax(jnp.where(own, apart_m, -1.0))] - first_m
        length_m, outward = _length(chord), _unit(first_m - place_m)
        across = jnp.stack([-chord[1], chord[0]]) / jnp.maximum(length_m, _CHORD_M)
        across = across * jnp.where(jnp.sum(across * outward) < 0.0, -1.0, 1.0)
        deep_m = jnp.sqrt(jnp.maximum(_PERSON_M**2 - 0.25 * length_m**2, 0.0))
        sure = length_m > _CHORD_M
        middle_m = first_m + jnp.where(sure, 0.5 * chord + deep_m * across, _PERSON_M * outward)
        found.append(Seen(first_m, middle_m, sure, jnp.any(own)))
        strange &= ~own
    return Seen(*(jnp.stack(each) for each in zip(*found, strict=True)))


def _followed(people: People, place_m: Point, seen: Seen) -> People:
    """Returns the people after a scan: those seen, moved on, and those who may only be hidden; the nearest of them."""
    known = people.unseen <= _BELIEVED
    expected_m = people.place_m + _CONTROL_S * people.velocity
    apart_m = jnp.where(known[None], _length(seen.middle_m[:, None] - expected_m[None]), _FAR_M)
    match = jnp.argmin(apart_m, axis=1)
    again = seen.there & (jnp.min(apart_m, axis=1) < _AGAIN_M)
    # Of one end alone, the middle is as far from it as a person is wide, about where it was to be.
    about_m = seen.end_m + _PERSON_M * _unit(expected_m[match] - seen.end_m)
    off_m = jnp.where(seen.sure[:, None], seen.middle_m, about_m) - expected_m[match]
    gain = jnp.where(seen.sure, _SPEED_GAIN, _GUESSED_GAIN)[:, None]
    speed = people.velocity[match] + gain / _CONTROL_S * off_m
    speed = speed * jnp.minimum(1.0, _TOP_SPEED_M_S / jnp.maximum(_length(speed), 1e-6))[:, None]
    now_m = jnp.where(again[:, None], expected_m[match] + _PLACE_GAIN * off_m, seen.middle_m)
    velocity = jnp.where(again[:, None], speed, 0.0)
    met = jnp.any(again[:, None] & (match[:, None] == jnp.arange(_FOLLOWED)[None]), axis=0)
    all_m = jnp.concatenate([now_m, expected_m])
    gone = _BELIEVED + 1
    unseen = jnp.concatenate([jnp.where(seen.there, 0, gone), jnp.where(met, gone, people.unseen + 1)])
    unseen = jnp.minimum(unseen, gone)
    order = jnp.argsort(jnp.where(unseen <= _BELIEVED, _length(all_m - place_m), _FAR_M))[:_FOLLOWED]
    return people._replace(
        place_m=all_m[order],
        velocity=jnp.concatenate([velocity, people.velocity])[order],
        unseen=unseen[order],
    )


class Tries(NamedTuple):
    """Ways that the robot tries, the planned one first.

    Attributes:
        turn_rad: From where it looks.
        pace_m_s: How fast; 0 for standing.
        back: Whether it drives backwards.
        way: Their directions in the map's frame.
        at_m: Where it would be at the times of ``_after_s``.
    """

    turn_rad: Float[jax.Array, "tries"]
    pace_m_s: Float[jax.Array, "tries"]
    back: Bool[jax.Array, "tries"]
    way: Float[jax.Array, "tries 2"]
    at_m: Float[jax.Array, "tries looks 2"]


def _after_s() -> Float[jax.Array, "looks"]:
    return jnp.asarray(_AHEAD_S / _LOOKS * np.arange(1, _LOOKS + 1), jnp.float32)


def _tries(pose: Float[jax.Array, "3"], planned: Planned) -> Tries:
    around_rad = np.arange(_DIRECTIONS) * 2.0 * np.pi / _DIRECTIONS
    around_rad = jnp.asarray(np.where(around_rad > np.pi, around_rad - 2.0 * np.pi, around_rad), jnp.float32)
    turn_rad = jnp.concatenate([planned.turn_rad[None], *[around_rad] * len(_PACES), jnp.zeros(1)])
    shares = [1.0, *(share for share in _PACES for _ in range(_DIRECTIONS)), 0.0]
    pace_m_s = planned.most_m_s * jnp.asarray(shares, jnp.float32)
    back = (jnp.abs(turn_rad) > _BACK_RAD) & (jnp.arange(len(shares)) > 0)
    to_turn_rad = jnp.where(back, np.pi - jnp.abs(turn_rad), jnp.abs(turn_rad))
    late_s = jnp.maximum(to_turn_rad - _QUICK_TURN_RAD, 0.0) / _TURN_RAD_S
    gone_m = pace_m_s[:, None] * jnp.maximum(_after_s()[None] - late_s[:, None], 0.0)
    # The plan bends behind its next point.
    gone_m = gone_m.at[0].min(_length(planned.target_m - pose[:2]))
    way = jnp.stack([jnp.cos(pose[2] + turn_rad), jnp.sin(pose[2] + turn_rad)], axis=1)
    return Tries(turn_rad, pace_m_s, back, way, pose[:2] + gone_m[..., None] * way[:, None])


def _best(tries: Tries, people: People, room: Room, place_m: Point, planned: Planned) -> Int[jax.Array, ""]:
    """Returns the number of the best way: the planned one where it keeps clear of people."""
    after_s = _after_s()
    will_m = _places(people)[:, None] + after_s[None, :, None] * people.velocity[:, None]
    gap_m = jnp.min(_length(tries.at_m[:, None] - will_m[None]), axis=1) - RADIUS_M - _PERSON_M
    wished_m, soon = _GAP_M + _UNSURE_M_S * after_s, 1.0 - 0.7 * after_s / _AHEAD_S
    near = jnp.mean(soon * (jnp.maximum(wished_m - gap_m, 0.0) / wished_m) ** 2, axis=1)
    hit = jnp.max(jnp.where(gap_m < _TOUCH_M, soon, 0.0), axis=1)
    # Where it stands less free than that, it may go wherever it is no less.
    least_m = jnp.minimum(_WALL_M, _room_m(room, place_m))
    blocked = jnp.any((_room_m(room, tries.at_m) < least_m) & (after_s < _FREE_S), axis=1).at[0].set(False)
    nearer_m = _length(tries.at_m[:, _LOOKS // 2] - planned.target_m) - _length(place_m - planned.target_m)
    same = jnp.where(tries.pace_m_s > 0.0, jnp.sum(tries.way * people.heading, axis=1), 0.0)
    cost = _NEAR * near + _HIT * hit + _ON * nearer_m / jnp.maximum(planned.most_m_s, _CALM_M_S)
    cost += _SWERVE * jnp.abs(tries.turn_rad) - _KEEP * same + jnp.where(blocked, _FAR_M, 0.0)
    return jnp.where((near[0] <= 0.0) & (hit[0] <= 0.0), 0, jnp.argmin(cost))


def _controlled(
    people: People,
    room: Room,
    pose: Float[jax.Array, "3"],
    ranges_m: Float[jax.Array, "rays"],
    planned: Planned,
) -> Known:
    """Returns the control of the best way, calm where people are before it, and the people with what was chosen."""
    tries = _tries(pose, planned)
    best = _best(tries, people, room, pose[:2], planned)
    own, back, way = best > 0, tries.back[best], tries.way[best]
    to_m = _places(people) - pose[:2]
    before = jnp.sum(_unit(to_m) * way, axis=1) > _BEFORE
    gap_m = jnp.min(jnp.where(before, _length(to_m), _FAR_M)) - RADIUS_M - _PERSON_M
    calm_m_s = _CALM_M_S + _CALM_PER_M * jnp.maximum(gap_m, 0.0)
    error = tries.turn_rad[best] + jnp.where(back, np.pi, 0.0)
    error = jnp.arctan2(jnp.sin(error), jnp.cos(error))
    free_m = jnp.min(jnp.where(back, free_behind(ranges_m), free_ahead(ranges_m)))
    stopping_m_s = jnp.sqrt(2.0 * _BRAKE_M_S2 * jnp.maximum(free_m - _TOUCH_M, 0.0))
    aligned = jnp.maximum(jnp.cos(error), 0.0) ** 2
    pace_m_s = jnp.minimum(jnp.minimum(tries.pace_m_s[best], calm_m_s) * aligned, stopping_m_s)
    turn = jnp.clip(_TURN_GAIN * error, -_TURN_RAD_S, _TURN_RAD_S)
    chosen = jnp.stack([jnp.where(back, -pace_m_s, pace_m_s), turn, jnp.zeros_like(turn)])
    calmed = planned.control.at[0].min(calm_m_s)
    heading = jnp.where(own & (tries.pace_m_s[best] > 0.0), way, 0.0)
    return people._replace(heading=heading), jnp.where(own, chosen, calmed)


def _places(people: People) -> Float[jax.Array, "people 2"]:
    """Returns where people are; far away where nobody is."""
    return jnp.where((people.unseen <= _BELIEVED)[:, None], people.place_m, _FAR_M)


def _room_m(room: Room, points_m: Float[jax.Array, "*each 2"]) -> Float[jax.Array, "*each"]:
    """Returns the clearances at points, as the map has them."""
    return _UNIT_M * room.units[cell_of(room, room.units.shape, points_m)].astype(jnp.float32)


def _length(vectors: Float[jax.Array, "*each 2"]) -> Float[jax.Array, "*each"]:
    return jnp.sqrt(jnp.sum(vectors**2, axis=-1))


def _unit(vectors: Float[jax.Array, "*each 2"]) -> Float[jax.Array, "*each 2"]:
    return vectors / jnp.maximum(_length(vectors), 1e-6)[..., None]
