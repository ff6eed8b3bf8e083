"""How robots meet people: whose contact it is, who cannot give way, when they would collide, and who waits."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from specs.data.episode import CONTROL_S
from specs.data.people import PERSON_RADIUS_M, TRANSIENT_S, People
from tasks.simulate.application.contract import Body, PeopleWork
from tasks.simulate.geometry.walks import walks_in
from tasks.simulate.lane.walkers import (
    Meetings,
    PeopleInputs,
    PeopleState,
    begin_people,
    meet,
    robot_disc,
    to_collision_s,
    walk,
)
from tests.factories.simulations import hall

HULL_M = 0.2
REACH_M = HULL_M + PERSON_RADIUS_M
WALL_M = 7.45
meeting, colliding = jax.jit(meet), jax.jit(to_collision_s)


@jax.jit
def walking(person: PeopleInputs, state: PeopleState, body: Body) -> PeopleState:
    return walk(person, state, [robot_disc(body.qpos, body.qvel, HULL_M)])


@pytest.fixture(scope="module")
def person() -> PeopleInputs:
    """One person in a hall with a wall at the end of x."""
    one = walks_in(hall(8.0)).people(People(count=1), 3, np.full(2, 3.0), HULL_M)
    return PeopleInputs(*jax.tree.map(jnp.asarray, one))


def robot(x_m: float, y_m: float = 0.0, vx: float = 0.0, vy: float = 0.0) -> Body:
    return Body(jnp.array([x_m, y_m, 0.0]), jnp.array([vx, vy, 0.0]), jnp.zeros(0), jnp.zeros(3))


def standing_at(person: PeopleInputs, x_m: float, vx: float = 0.0) -> PeopleState:
    """Returns the person at a place of the hall's middle, on its way along x."""
    begun = begin_people(person)
    there = jnp.zeros_like(begun.velocity).at[0, 0].set(vx)
    return begun._replace(place_m=begun.place_m.at[0].set(jnp.array([x_m, 0.0])), velocity=there, meant=there)


class Step(NamedTuple):
    """What an engine says of a step: what people pushed with, and how far the next one is."""

    impulse_ns: float
    distance_m: float


def met(person: PeopleInputs, state: PeopleState, body: Body, *steps: Step) -> Meetings:
    for step in steps:
        work = PeopleWork(jnp.float32(step.impulse_ns), jnp.float32(step.distance_m))
        state = state._replace(meetings=meeting(person, state, body, work))
    return state.meetings


TOUCH, AWAY = Step(0.5, -0.001), Step(0.0, 0.2)


def test_a_contact_that_the_robot_makes_has_its_speed(person: PeopleInputs):
    found = met(person, standing_at(person, 0.0), robot(-REACH_M, vx=0.5), TOUCH, TOUCH, AWAY, TOUCH)
    assert (int(found.contacts), int(found.standing_contacts)) == (2, 0)
    assert (float(found.contact_m_s), float(found.impact_m_s)) == pytest.approx((0.5, 0.5))


def test_who_walks_into_a_robot_that_stands_still_is_counted_apart_and_hit_by_nothing(person: PeopleInputs):
    found = met(person, standing_at(person, 0.0, vx=-0.9), robot(-REACH_M, vx=0.01), TOUCH)
    assert (int(found.contacts), int(found.standing_contacts)) == (1, 1)
    assert float(found.contact_m_s) == pytest.approx(0.91)
    assert (float(found.impact_m_s), float(found.pinned_m_s)) == (0.0, 0.0)


def test_a_person_whom_the_robot_has_stopped_hit_it_as_fast_as_it_meant_to_go(person: PeopleInputs):
    """A person before a robot has come to rest when an engine tells of the contact."""
    coming = standing_at(person, 0.0, vx=-0.9)
    stopped = coming._replace(velocity=jnp.zeros_like(coming.velocity))
    assert float(met(person, stopped, robot(-REACH_M, vx=0.5), TOUCH).contact_m_s) == pytest.approx(1.4)


def test_a_person_before_a_wall_is_pinned_and_one_in_the_open_or_beside_it_is_not(person: PeopleInputs):
    at_the_wall = standing_at(person, WALL_M - PERSON_RADIUS_M - 0.05)
    x_m = float(at_the_wall.place_m[0, 0])
    assert float(met(person, at_the_wall, robot(x_m - REACH_M, vx=0.5), TOUCH).pinned_m_s) == pytest.approx(0.5)
    along = robot(x_m, -REACH_M, vy=0.5)
    assert float(met(person, at_the_wall, along, TOUCH).pinned_m_s) == 0.0
    open_floor = standing_at(person, 0.0)
    assert float(met(person, open_floor, robot(-REACH_M, vx=0.5), TOUCH).pinned_m_s) == 0.0


def test_who_has_more_room_behind_than_the_robot_goes_in_an_impact_is_not_pinned(person: PeopleInputs):
    speed = 0.8
    for left_m, pinned in ((speed * TRANSIENT_S - 0.1, True), (speed * TRANSIENT_S + 0.1, False)):
        state = standing_at(person, WALL_M - PERSON_RADIUS_M - left_m)
        body = robot(float(state.place_m[0, 0]) - REACH_M, vx=speed)
        assert (float(met(person, state, body, TOUCH).pinned_m_s) > 0.0) == pinned


def test_pressing_is_what_goes_on_for_longer_than_an_impact(person: PeopleInputs):
    state, body = standing_at(person, 0.0), robot(-REACH_M, vx=0.5)
    blow, push = Step(9.0, -0.001), Step(0.7, -0.001)
    lasting = round(TRANSIENT_S / CONTROL_S)
    assert float(met(person, state, body, blow, *[push] * (lasting - 1)).pressed_ns) == 0.0
    assert float(met(person, state, body, blow, *[push] * lasting).pressed_ns) == pytest.approx(0.7)
    broken = [*[push] * (lasting - 1), AWAY, push]
    assert float(met(person, state, body, *broken).pressed_ns) == 0.0


def test_a_robot_freezes_while_it_stands_still_near_a_person(person: PeopleInputs):
    state, near, far = standing_at(person, 0.0), Step(0.0, 1.1), Step(0.0, 1.3)
    stands, drives = robot(-1.5), robot(-1.5, vx=0.1)
    found = met(person, state, stands, *[near] * 5, far, *[near] * 3)
    assert (int(found.frozen_steps), int(found.still_steps)) == (5, 3)
    assert int(met(person, state, drives, *[near] * 5).frozen_steps) == 0


# Two discs of which one goes at 2 m/s through a gap of 4 m, and worked out by hand where they pass each other aside.
@pytest.mark.parametrize(
    ("place", "speed", "walk_m_s", "after_s"),
    [
        ((-4.0 - REACH_M, 0.0), (2.0, 0.0), 0.0, 2.0),
        ((-4.0 - REACH_M, 0.0), (1.0, 0.0), -1.0, 2.0),
        ((-4.0 - REACH_M, 0.0), (1.0, 0.0), 1.5, np.inf),
        ((-3.0, 0.6 * REACH_M), (1.0, 0.0), 0.0, 3.0 - 0.8 * REACH_M),
        ((-3.0, 1.01 * REACH_M), (1.0, 0.0), 0.0, np.inf),
        ((-0.9 * REACH_M, 0.0), (-1.0, 0.0), 0.0, 0.0),
        ((-3.0, 0.0), (0.0, 0.0), 0.0, np.inf),
    ],
)
def test_the_time_to_a_collision_is_that_of_two_discs_that_keep_their_velocities(
    person: PeopleInputs, place: tuple[float, float], speed: tuple[float, float], walk_m_s: float, after_s: float
):
    found = colliding(standing_at(person, 0.0, vx=walk_m_s), robot(*place, *speed), HULL_M)
    assert float(found) == pytest.approx(after_s, abs=1e-4)


def test_a_person_who_walks_into_the_robot_means_to_walk_on(person: PeopleInputs):
    blind = person._replace(aware=jnp.zeros_like(person.aware))
    state, far = begin_people(blind), robot(50.0)
    for _ in range(40):
        state = walking(blind, state, far)
    onward, place = state.velocity[0], state.place_m[0]
    assert float(jnp.hypot(*onward)) > 0.5
    np.testing.assert_allclose(state.meant[0], onward, atol=1e-5)
    before = place + onward / jnp.hypot(*onward) * (REACH_M + 0.01)
    stopped = walking(blind, state, robot(*before.tolist()))
    assert float(jnp.hypot(*stopped.velocity[0])) < 0.5 * float(jnp.hypot(*onward))
    np.testing.assert_allclose(jnp.hypot(*stopped.meant[0]), jnp.hypot(*onward), rtol=0.05)
