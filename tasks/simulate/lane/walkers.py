"""People in a lane: how they walk in a control step, and how near the robot comes to them.

Each follows the corners of its round, keeps clear of the others and, unless it does not see them, of robots
(``orca``), and of solids by the map of the room that a person has. Whoever gets no further turns to the right bit by
bit, as two who stand before each other at a wall would stay there for good; after its patience it turns back to the
place that it came from.

Who does a recorded walk again keeps clear of nobody: it is where the walk says, and waits while the robot stands there.
"""

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from specs.data.episode import CONTROL_S
from specs.data.people import INTIMATE_M, PERSON_HEIGHT_M, PERSON_RADIUS_M, PERSONAL_M, STANDING_M_S, TRANSIENT_S
from tasks.simulate.application.contract import Body, PeopleWork
from tasks.simulate.geometry.obstacles import PARKING_M
from tasks.simulate.geometry.walks import Recording
from tasks.simulate.lane.orca import Disc, HalfPlane, Scalar, Vector, choose, nearest_velocity, neighbour_plane

# Of other people and robots, so many of the nearest are kept clear of.
_NEIGHBOURS = 4
_HORIZON_S = 2.0
# Who likes to walk at a pace can be so much faster to get out of the way.
_TOP_SPEED = 1.3
# The point on its way that a person walks to is so far ahead.
_AHEAD_M = 0.6
# How near to a place, and to a bend of the way, is there.
_THERE_M, _BEND_M = 0.3, 0.15
# For how long a person looks ahead at solids: beside it, and where it would be.
_WALL_S, _LOOK_S = 0.2, 0.4
# Less than this share of its pace is no progress.
_SLOW = 0.25
# Whoever makes none for so long turns aside, so fast: all the way round within the longest patience.
_ASIDE_AFTER_S, _ASIDE_RAD_S = 0.5, 2.0
# Whoever turned back keeps to it so many times longer: those in a narrow place must all want out of it at one time.
_BACK = 3.0
# Whoever goes its way leaves so much room to others; who turned back uses it, so that no three at walls lock for good.
_PLAY_M = 0.05
# Whoever went back to a place stays there for less: it has waited enough.
_BACK_STAY = 0.3
# A person stops this deep in a robot that it walks into.
_PRESS_M = 0.005
# What numbers of 32 bits may add to the speed at which people come nearer to one another.
_ROUNDED_M_S = 1e-4
_FLAT = 0.1
_JUMP_M_S = 10.0
_TINY_M = 1e-6
# Places behind a person that are looked at for a wall, and how far its surface gives way there.
_BEHIND, _GIVE_M = 4, 0.02
_TRANSIENT_STEPS = round(TRANSIENT_S / CONTROL_S)
# Any tree of arrays.
Given = TypeVar("Given")
Found = TypeVar("Found")


class PeopleInputs(NamedTuple):
    """The people of a lane; fields as in ``HostPeople``."""

    there: Bool[jax.Array, "people"]
    aware: Bool[jax.Array, "people"]
    speed_m_s: Float[jax.Array, "people"]
    lean_rad: Float[jax.Array, "people"]
    patience_s: Float[jax.Array, "people"]
    corners_m: Float[jax.Array, "people corners 2"]
    corner_count: Int[jax.Array, "people"]
    stay_s: Float[jax.Array, "people corners"]
    toward: Int[jax.Array, "people"]
    place_m: Float[jax.Array, "people 2"]
    room_m: Float[jax.Array, "rows columns"]
    low_m: Float[jax.Array, "2"]
    cell_m: Float[jax.Array, ""]
    recording: Recording | None = None


class Meetings(NamedTuple):
    """How the robot met people until now; fields as in EpisodeResult, times in control steps.

    Attributes:
        standing_contacts: Contacts that began while the robot stood still; speeds of impact are of all others.
        touching_steps: For how long it has touched one.
        impact_m_s: The highest speed of robot and person against each other at which it touched one.
        pinned_m_s: The same of those whom a solid kept from giving way.
        pressed_ns: The most that it pushed one within a control step, where it went on for longer than an impact does.
        collision_s: The least time to a collision.
        still_steps: For how long it has stood still near one; ``frozen_steps`` is the longest such time.
    """

    contacts: Int[jax.Array, ""]
    standing_contacts: Int[jax.Array, ""]
    touching_steps: Int[jax.Array, ""]
    contact_m_s: Float[jax.Array, ""]
    impact_m_s: Float[jax.Array, ""]
    pinned_m_s: Float[jax.Array, ""]
    pressed_ns: Float[jax.Array, ""]
    least_m: Float[jax.Array, ""]
    collision_s: Float[jax.Array, ""]
    personal_steps: Int[jax.Array, ""]
    intimate_steps: Int[jax.Array, ""]
    still_steps: Int[jax.Array, ""]
    frozen_steps: Int[jax.Array, ""]


class PeopleState(NamedTuple):
    """What changes of the people in a lane.

    Attributes:
        place_m, velocity: Of each; far away where there is nobody.
        meant: The velocity that each would have without robots in its way: with that it walks into one.
        toward: The corner that each walks to; of a recorded walk, how many control steps of it are done.
        way: 1 along its round, -1 back.
        stay_s: How long it still stays where it is.
        stalled_s: For how long it has made no progress.
        meetings: With the robot.
    """

    place_m: Float[jax.Array, "people 2"]
    velocity: Float[jax.Array, "people 2"]
    meant: Float[jax.Array, "people 2"]
    toward: Int[jax.Array, "people"]
    way: Int[jax.Array, "people"]
    stay_s: Float[jax.Array, "people"]
    stalled_s: Float[jax.Array, "people"]
    meetings: Meetings


def begin_people(people: PeopleInputs) -> PeopleState:
    """Returns the people of a lane before the first control step."""
    zero, none = jnp.zeros(()), jnp.zeros((), jnp.int32)
    far = jnp.full((), jnp.inf)
    meetings = Meetings(none, none, none, zero, zero, zero, zero, far, far, none, none, none, none)
    still = jnp.zeros_like(people.speed_m_s)
    away = PARKING_M + jnp.arange(len(people.there), dtype=jnp.float32)[:, None]
    place_m = jnp.where(people.there[:, None], people.place_m, away)
    velocity, way = jnp.zeros_like(place_m), jnp.ones_like(people.toward)
    return PeopleState(place_m, velocity, velocity, people.toward, way, still, still, meetings)


def robot_disc(place_m: Float[jax.Array, "numbers"], velocity: Float[jax.Array, "numbers"], radius_m: float) -> Disc:
    """Returns a robot as people meet it.

    Args:
        place_m: Where it is (x, y, and what there is besides).
        velocity: How it moves, likewise.
        radius_m: Of its hull.
    """
    return Disc(_vector(place_m), _vector(velocity), jnp.full((), radius_m))


def walk(people: PeopleInputs, state: PeopleState, robots: Sequence[Disc]) -> PeopleState:
    """Returns the people a control step later.

    Args:
        people: Of the lane.
        state: Before the step.
        robots: All that drive in their world, at least one, likewise.
    """
    if people.recording is not None:
        return _walk_again(people, people.recording, state, robots)
    place, velocity = _vector(state.place_m), _vector(state.velocity)
    state, onward = _next_corner(people, state, place)
    stays = state.stay_s > 0.0
    own = Disc(place, velocity, PERSON_RADIUS_M + jnp.where(state.way > 0, _PLAY_M, 0.0))
    turn_rad = people.lean_rad - _ASIDE_RAD_S * jnp.maximum(state.stalled_s - _ASIDE_AFTER_S, 0.0)
    cos, sin = jnp.cos(turn_rad), jnp.sin(turn_rad)
    lean = Vector(cos * onward.x - sin * onward.y, sin * onward.x + cos * onward.y)
    preferred = lean.scaled(jnp.where(stays, 0.0, people.speed_m_s))
    (beside_m, out), ahead = _turns(functools.partial(_room, people), [place, place.plus(preferred, _LOOK_S)])
    planes = [_wall_beside(beside_m, out), _wall_ahead(*ahead, preferred), *_neighbours(people, own, robots)]
    chosen = nearest_velocity(planes, 2, preferred, _TOP_SPEED * people.speed_m_s)
    stopped = _stopped_by(robots, place, chosen)
    walked = _on_the_floor(people, own, beside_m, out, stopped)
    walked = choose(people.there, walked, Vector(jnp.zeros_like(place.x), jnp.zeros_like(place.y)))
    slow = walked.dot(onward) < _SLOW * people.speed_m_s
    stalled_s = jnp.where(slow & ~stays, state.stalled_s + CONTROL_S, 0.0)
    back = stalled_s > people.patience_s * jnp.where(state.way > 0, 1.0, _BACK)
    return state._replace(
        place_m=_together(place.plus(walked, CONTROL_S)),
        velocity=_together(walked),
        meant=_together(walked.plus(chosen).plus(stopped, -1.0)),
        toward=jnp.where(back, _turned_back(people, state, place), state.toward),
        way=jnp.where(back, -state.way, state.way),
        stalled_s=jnp.where(back, 0.0, stalled_s),
    )


def _walk_again(people: PeopleInputs, walks: Recording, state: PeopleState, robots: Sequence[Disc]) -> PeopleState:
    """Returns the people a control step of their recorded walks later; who would walk into a robot waits."""
    step = state.toward + 1
    to_m = jnp.where(people.there[:, None], recorded_m(walks, step * CONTROL_S), state.place_m)
    waits = jnp.zeros_like(people.there)
    for robot in robots:
        robot_m, near_m = _together(robot.place), robot.radius_m + PERSON_RADIUS_M - _PRESS_M
        before_m, after_m = (jnp.sqrt(jnp.sum((each - robot_m) ** 2, axis=1)) for each in (state.place_m, to_m))
        waits = waits | ((after_m < near_m) & (after_m < before_m))
    place_m = jnp.where(waits[:, None], state.place_m, to_m)
    velocity, meant = ((each - state.place_m) / CONTROL_S for each in (place_m, to_m))
    walked = jnp.sum(velocity**2, axis=1, keepdims=True) < _JUMP_M_S**2  # a walk that begins anew may jump
    return state._replace(
        place_m=place_m,
        velocity=jnp.where(walked, velocity, 0.0),
        meant=jnp.where(jnp.sum(meant**2, axis=1, keepdims=True) < _JUMP_M_S**2, meant, 0.0),
        toward=jnp.where(waits, state.toward, step),
    )


def recorded_m(walks: Recording, t_s: Float[jax.Array, "people"]) -> Float[jax.Array, "people 2"]:
    """Returns where people are at times of their walks, each straight between two of its places."""
    t_s = jnp.where(jnp.isfinite(walks.period_s), jnp.mod(t_s, walks.period_s), t_s)
    last = jnp.sum(walks.at_s <= t_s[:, None], axis=1) - 1
    since = jnp.clip(last, 0, walks.at_s.shape[1] - 2)[:, None]
    begin_s, end_s = (jnp.take_along_axis(walks.at_s, each, 1)[:, 0] for each in (since, since + 1))
    share = jnp.where(jnp.isfinite(end_s), jnp.clip((t_s - begin_s) / (end_s - begin_s), 0.0, 1.0), 0.0)
    begin_m, end_m = (jnp.take_along_axis(walks.places_m, each[..., None], 1)[:, 0] for each in (since, since + 1))
    return begin_m + share[:, None] * (end_m - begin_m)


def _next_corner(people: PeopleInputs, state: PeopleState, place: Vector) -> tuple[PeopleState, Vector]:
    """Returns the people with the corners that they walk to now, and in which direction each goes on."""
    to, stay_s = _corner(people, state.toward), _stay_s(people, state.toward)
    is_place, away = stay_s > 0.0, to.plus(place, -1.0)
    since = _corner(people, _before(people, state))
    leg = to.plus(since, -1.0)
    passed = place.plus(since, -1.0).dot(leg) >= leg.dot(leg)
    near = away.dot(away) <= jnp.where(is_place, _THERE_M, _BEND_M) ** 2
    arrived = near | (passed & ~is_place)
    way = jnp.where(arrived & is_place, 1, state.way)  # whoever went back for others sets out again
    toward = jnp.where(arrived, _around(people, state.toward + way), state.toward)
    left_s = jnp.maximum(state.stay_s - CONTROL_S, 0.0)
    stay_s = stay_s * jnp.where(state.way > 0, 1.0, _BACK_STAY)
    after = state._replace(toward=toward, way=way, stay_s=jnp.where(arrived & is_place, stay_s, left_s))
    return after, _onward(_corner(people, _before(people, after)), _corner(people, toward), place)


def _turned_back(people: PeopleInputs, state: PeopleState, place: Vector) -> Int[jax.Array, "people"]:
    """Returns the corner that each would go back to: not a place where it still is, which others want to pass."""
    before = _before(people, state)
    away = _corner(people, before).plus(place, -1.0)
    still_there = (_stay_s(people, before) > 0.0) & (away.dot(away) <= _THERE_M**2)
    return jnp.where(still_there, _around(people, before - state.way), before)


def _before(people: PeopleInputs, state: PeopleState) -> Int[jax.Array, "people"]:
    """Returns the corner that each comes from."""
    return _around(people, state.toward - state.way)


def _around(people: PeopleInputs, number: Int[jax.Array, "people"]) -> Int[jax.Array, "people"]:
    """Returns the numbers of corners, of which those one before the first or behind the last go on at the other end."""
    # A remainder takes a division of whole numbers, which no processor does for several at a time.
    count = people.corner_count
    return jnp.where(number < 0, number + count, jnp.where(number >= count, number - count, number))


def _corner(people: PeopleInputs, number: Int[jax.Array, "people"]) -> Vector:
    return _vector(jnp.take_along_axis(people.corners_m, number[:, None, None], axis=1)[:, 0])


def _stay_s(people: PeopleInputs, number: Int[jax.Array, "people"]) -> Scalar:
    return jnp.take_along_axis(people.stay_s, number[:, None], axis=1)[:, 0]


def _onward(since: Vector, to: Vector, place: Vector) -> Vector:
    """Returns the direction to a point on the leg, somewhat ahead of where a person is beside it."""
    leg = to.plus(since, -1.0)
    length_m = jnp.sqrt(leg.dot(leg))
    along = leg.scaled(1.0 / jnp.maximum(length_m, _TINY_M))
    gone_m = jnp.clip(place.plus(since, -1.0).dot(along) + _AHEAD_M, 0.0, length_m)
    return since.plus(along, gone_m).plus(place, -1.0).unit()


def _neighbours(people: PeopleInputs, own: Disc, robots: Sequence[Disc]) -> list[HalfPlane]:
    """Returns what the nearest of others leave to each, nearest first; nobody does a robot's share."""
    count, in_all = len(people.there), len(people.there) + len(robots)
    x, y, vx, vy = (
        jnp.append(mine, jnp.stack(theirs))
        for mine, *theirs in zip(
            (*own.place, *own.velocity), *((*each.place, *each.velocity) for each in robots), strict=True
        )
    )
    radius_m = jnp.append(own.radius_m, jnp.stack([each.radius_m for each in robots]))
    aware = jnp.repeat(people.aware[None], len(robots), axis=0)
    seen = jnp.concatenate([people.there[:, None] & ~jnp.eye(count, dtype=bool), aware])
    squared = (x[:, None] - own.place.x[None]) ** 2 + (y[:, None] - own.place.y[None]) ** 2
    squared = jnp.where(seen, squared, jnp.inf)

    def nearest_but(gone: Bool[jax.Array, "all people"], _: None) -> tuple[jax.Array, tuple[Scalar, Scalar]]:
        nearest_m, nearest = jnp.full(count, jnp.inf), jnp.zeros(count, jnp.int32)
        for number in range(in_all):
            nearer = ~gone[number] & (squared[number] < nearest_m)
            nearest_m, nearest = jnp.where(nearer, squared[number], nearest_m), jnp.where(nearer, number, nearest)
        return gone | (jnp.arange(in_all)[:, None] == nearest[None]), (nearest, nearest_m < jnp.inf)

    def disc(nearest: Int[jax.Array, "people"]) -> Disc:
        x_m, y_m, *velocity, other_m = (_chosen(nearest, each) for each in (x, y, vx, vy, radius_m))
        return Disc(Vector(x_m, y_m), Vector(*velocity), other_m)

    def plane(other: Disc, nearest: Int[jax.Array, "people"], there: Bool[jax.Array, "people"]) -> HalfPlane:
        share = jnp.where(nearest >= count, 1.0, 0.5)
        return neighbour_plane(own, other, share=share, horizon_s=_HORIZON_S, step_s=CONTROL_S, there=there)

    # Three loops, as in ``_turns``, each of few operations.
    _, (nearest, there) = jax.lax.scan(nearest_but, jnp.zeros_like(seen), None, length=_NEIGHBOURS)
    others = jax.lax.map(disc, nearest)
    planes = jax.lax.map(lambda each: plane(*each), (others, nearest, there))
    return [jax.tree.map(lambda each, turn=turn: each[turn], planes) for turn in range(_NEIGHBOURS)]


def _chosen(number: Int[jax.Array, "people"], each: Float[jax.Array, "all"]) -> Scalar:
    """Returns the one of all with each number. A choice among all: no processor looks up several places at a time."""
    return functools.reduce(lambda so_far, k: jnp.where(number == k, each[k], so_far), range(1, len(each)), each[0])


def _room(people: PeopleInputs, place: Vector) -> tuple[Scalar, Vector]:
    """Returns how much room is left around each person, and in which direction there is more."""
    rows, columns = people.room_m.shape
    # A division by what all people of a lane share becomes such a product in some programs and in others not, by how
    # many devices there are: so it is one in all.
    per_m = 1.0 / people.cell_m
    x = jnp.clip((place.x - people.low_m[0]) * per_m, 0.0, columns - 1.001)
    y = jnp.clip((place.y - people.low_m[1]) * per_m, 0.0, rows - 1.001)
    column, row = x.astype(jnp.int32), y.astype(jnp.int32)
    right, up = x - column, y - row
    flat, first = people.room_m.reshape(-1), row * columns + column
    low, beside, above, across = flat[first], flat[first + 1], flat[first + columns], flat[first + columns + 1]
    room_m = (1.0 - up) * ((1.0 - right) * low + right * beside) + up * ((1.0 - right) * above + right * across)
    rise = Vector(
        ((1.0 - up) * (beside - low) + up * (across - above)) * per_m,
        ((1.0 - right) * (above - low) + right * (across - beside)) * per_m,
    )
    return room_m, rise


def _wall(out: Vector, speed_m_s: Scalar) -> HalfPlane:
    """Returns the velocities that go out from a wall by at least as much; who rests is always in it."""
    steep = out.dot(out) > _FLAT**2
    away = out.unit()
    return HalfPlane(away.scaled(jnp.minimum(speed_m_s, 0.0)), Vector(away.y, -away.x), steep)


def _wall_beside(room_m: Scalar, out: Vector) -> HalfPlane:
    return _wall(out, -room_m / _WALL_S)


def _wall_ahead(room_m: Scalar, out: Vector, preferred: Vector) -> HalfPlane:
    return _wall(out, preferred.dot(out.unit()) - room_m / _LOOK_S)


def _stopped_by(robots: Sequence[Disc], place: Vector, velocity: Vector) -> Vector:
    """Returns the velocities with which people walk against robots, but not into them."""
    toward, most_m_s = list[Vector](), list[Scalar]()
    for robot in robots:
        apart = robot.place.plus(place, -1.0)
        room_m = jnp.sqrt(apart.dot(apart)) - robot.radius_m - PERSON_RADIUS_M + _PRESS_M
        toward.append(apart.unit())
        most_m_s.append(jnp.maximum(room_m, 0.0) / CONTROL_S)
        too_fast = velocity.dot(toward[-1]) - most_m_s[-1]
        velocity = velocity.plus(toward[-1], -jnp.maximum(too_fast, 0.0))
    if len(robots) == 1:
        return velocity
    # Who slides along one may so come into another.
    for to_robot, most in zip(toward, most_m_s, strict=True):
        share = (most + _ROUNDED_M_S) / jnp.maximum(velocity.dot(to_robot), _ROUNDED_M_S)
        velocity = velocity.scaled(jnp.minimum(share, 1.0))
    return velocity


def _apart(people: PeopleInputs, own: Disc, velocity: Vector) -> Vector:
    """Returns the velocities with which no two people come nearer than they touch: each may go half of the way."""
    place, count = own.place, len(people.there)
    to = Vector(place.x[:, None] - place.x[None], place.y[:, None] - place.y[None])
    toward, length_m = to.unit(), jnp.sqrt(to.dot(to))
    others = people.there[:, None] & ~jnp.eye(count, dtype=bool)
    most_m_s = jnp.where(others, jnp.maximum(length_m / 2.0 - own.radius_m[None], 0.0) / CONTROL_S, jnp.inf)
    each = [(Vector(toward.x[k], toward.y[k]), most_m_s[k]) for k in range(count)]
    # Added one after the other: a sum along an axis takes far longer than as many sums of all people.
    over = [way.scaled(jnp.maximum(way.dot(velocity) - most, 0.0)) for way, most in each]
    slid = velocity.plus(functools.reduce(Vector.plus, over), -1.0)
    shares = [(most + _ROUNDED_M_S) / jnp.maximum(way.dot(slid), _ROUNDED_M_S) for way, most in each]
    return slid.scaled(jnp.minimum(functools.reduce(jnp.minimum, shares), 1.0))


def _on_the_floor(people: PeopleInputs, own: Disc, room_m: Scalar, out: Vector, velocity: Vector) -> Vector:
    """Returns the velocities that lead to where people have room: as they are, along the wall, or none."""
    least_m, away = jnp.minimum(room_m, 0.0), out.unit()

    def fits(some: Vector) -> Bool[jax.Array, "people"]:
        return _room(people, own.place.plus(some, CONTROL_S))[0] >= least_m

    along = velocity.plus(away, -jnp.minimum(velocity.dot(away), 0.0))
    slid = _turns(functools.partial(_apart, people, own), [velocity, along])
    (whole, along), fit = slid, _turns(fits, slid)
    return choose(fit[0], whole, choose(fit[1], along, whole.scaled(0.0)))


def _turns(function: Callable[[Given], Found], given: Sequence[Given]) -> list[Found]:
    """Returns what a function makes of each, as turns of a loop.

    So it is computed once: the compiler would compute it again in each of the operations that it makes of what follows.
    """
    stacked = jax.tree.map(lambda *each: jnp.stack(each), *given)
    _, found = jax.lax.scan(lambda _, each: (None, function(each)), None, stacked)
    return [jax.tree.map(lambda each, at=at: each[at], found) for at in range(len(given))]


def meet(people: PeopleInputs, state: PeopleState, robot: Body, work: PeopleWork) -> Meetings:
    """Returns how the robot met people until the end of a control step.

    Args:
        people: Of the lane.
        state: The people in the step.
        robot: At its beginning.
        work: What an engine made of it.
    """
    met, touching = state.meetings, work.impulse_ns > 0.0
    begins = touching & (met.touching_steps == 0)
    nearest = jnp.argmin(jnp.sum((state.place_m - robot.qpos[:2]) ** 2, axis=1))
    speed = jnp.sqrt(jnp.sum((state.meant[nearest] - robot.qvel[:2]) ** 2))
    own_m_s = jnp.sqrt(jnp.sum(robot.qvel[:2] ** 2))
    stands = own_m_s < STANDING_M_S
    hits = begins & ~stands
    pinned = hits & _is_pinned(people, state.place_m[nearest], robot, own_m_s)
    touching_steps = jnp.where(touching, met.touching_steps + 1, 0)
    pressed_ns = jnp.where(touching_steps > _TRANSIENT_STEPS, work.impulse_ns, 0.0)
    near = work.distance_m < PERSONAL_M
    still_steps = jnp.where(stands & near, met.still_steps + 1, 0)
    return Meetings(
        contacts=met.contacts + begins,
        standing_contacts=met.standing_contacts + (begins & stands),
        touching_steps=touching_steps,
        contact_m_s=jnp.where(begins, jnp.maximum(met.contact_m_s, speed), met.contact_m_s),
        impact_m_s=jnp.where(hits, jnp.maximum(met.impact_m_s, speed), met.impact_m_s),
        pinned_m_s=jnp.where(pinned, jnp.maximum(met.pinned_m_s, speed), met.pinned_m_s),
        pressed_ns=jnp.maximum(met.pressed_ns, pressed_ns),
        least_m=jnp.minimum(met.least_m, work.distance_m),
        collision_s=jnp.where(touching, 0.0, met.collision_s),
        personal_steps=met.personal_steps + near,
        intimate_steps=met.intimate_steps + (work.distance_m < INTIMATE_M),
        still_steps=still_steps,
        frozen_steps=jnp.maximum(met.frozen_steps, still_steps),
    )


def _is_pinned(people: PeopleInputs, place_m: Float[jax.Array, "2"], robot: Body, own_m_s: Scalar) -> Scalar:
    """Returns whether a person has less room behind it than the robot goes while an impact lasts: it cannot recoil."""
    away = _vector(place_m - robot.qpos[:2]).unit()
    behind_m = own_m_s * TRANSIENT_S * jnp.arange(1, _BEHIND + 1) / _BEHIND
    room_m, _ = _room(people, Vector(place_m[0] + behind_m * away.x, place_m[1] + behind_m * away.y))
    return jnp.any(room_m < -_GIVE_M)


def to_collision_s(state: PeopleState, robot: Body, robot_radius_m: float) -> Scalar:
    """Returns when the robot would first touch a person if all went on as they move now; infinite if it never would.

    The time to collision of Hayward (Near-miss determination through use of a scale of danger, 1972), for discs: the
    least t of at least 0 at which ``|p + t v|`` is the sum of the radii, 0 where it is less already.

    Args:
        state: The people.
        robot: At the same time.
        robot_radius_m: Of its hull.
    """
    apart, closing = _vector(state.place_m - robot.qpos[:2]), _vector(state.velocity - robot.qvel[:2])
    along, squared = apart.dot(closing), closing.dot(closing)
    outside = apart.dot(apart) - (robot_radius_m + PERSON_RADIUS_M) ** 2
    root = along**2 - squared * outside
    meets = (along < 0.0) & (root >= 0.0)
    at_s = outside / jnp.maximum(jnp.sqrt(jnp.maximum(root, 0.0)) - along, _TINY_M)
    return jnp.min(jnp.where(outside <= 0.0, 0.0, jnp.where(meets, at_s, jnp.inf)))


def people_circles(place_m: Float[jax.Array, "people 2"]) -> Float[jax.Array, "people 3"]:
    """Returns people as a lidar sees them: circles (x, y, radius)."""
    return _with_columns(place_m, PERSON_RADIUS_M)


def people_cylinders(place_m: Float[jax.Array, "people 2"]) -> Float[jax.Array, "people 5"]:
    """Returns people as a depth camera sees them: cylinders (x, y, lowest, highest, radius)."""
    return _with_columns(place_m, 0.0, PERSON_HEIGHT_M, PERSON_RADIUS_M)


def _with_columns(place_m: Float[jax.Array, "people 2"], *same: float) -> Float[jax.Array, "people numbers"]:
    return jnp.concatenate([place_m, jnp.broadcast_to(jnp.array(same, place_m.dtype), (len(place_m), len(same)))], 1)


def _vector(columns: Float[jax.Array, "... numbers"]) -> Vector:
    return Vector(columns[..., 0], columns[..., 1])


def _together(vector: Vector) -> Float[jax.Array, "... 2"]:
    return jnp.stack([vector.x, vector.y], axis=-1)
