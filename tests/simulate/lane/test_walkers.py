"""How people walk: never into furniture, never stuck, the same alone and among others, and stopped by a robot."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from specs.data.people import PERSON_HEIGHT_M, PERSON_RADIUS_M, People
from tasks.simulate.application.contract import Body
from tasks.simulate.devices import device_count
from tasks.simulate.engines.program import lane_mesh, split_over
from tasks.simulate.geometry.free_floor import clearance_m, solids_of
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.geometry.walks import walks_in
from tasks.simulate.lane.walkers import PeopleInputs, PeopleState, begin_people, walk
from tests.factories.simulations import cluttered

LANES, COUNT, STEPS, HULL_M = 8, 3, 2400, 0.2
FAR_M = 50.0


def inputs(seeds: range, unaware: float = 0.0) -> PeopleInputs:
    """Returns the people of a lane for each seed, lanes first."""
    walks = walks_in(cluttered(1))
    each = [walks.people(People(count=COUNT, unaware=unaware), seed, np.full(2, FAR_M), HULL_M) for seed in seeds]
    return PeopleInputs(*jax.tree.map(lambda *parts: jnp.stack([*map(jnp.asarray, parts)]), *each))


@jax.jit
def walked(people: PeopleInputs, robot_m: jax.Array) -> tuple[PeopleState, jax.Array]:
    """Returns where people are after two minutes, and their places in all steps, with a robot that stands."""
    body = Body(jnp.append(robot_m, 0.0), jnp.zeros(3), jnp.zeros(0), jnp.zeros(3))

    def step(state: PeopleState, _: None) -> tuple[PeopleState, jax.Array]:
        after = jax.vmap(lambda own, before: walk(own, before, body, HULL_M))(people, state)
        return after, after.place_m

    return jax.lax.scan(step, jax.vmap(begin_people)(people), None, length=STEPS)


@pytest.fixture(scope="module")
def ways() -> np.ndarray:
    """Places, of steps, lanes and people, far from the robot."""
    return np.asarray(walked(inputs(range(LANES)), jnp.full(2, FAR_M))[1])[:, :, :COUNT]


def test_nobody_is_ever_in_furniture(ways: np.ndarray):
    solids = solids_of(obstacles(cluttered(1), 0.05, PERSON_HEIGHT_M))
    assert clearance_m(solids, ways.reshape(-1, 2).astype(float)).min() >= PERSON_RADIUS_M


def test_nobody_is_stuck_for_half_a_minute(ways: np.ndarray):
    span = 600
    for first in range(0, STEPS - span, 100):
        part = ways[first : first + span]
        assert np.hypot(*np.moveaxis(np.ptp(part, axis=0), -1, 0)).min() > 0.3


def test_no_two_people_are_in_one_place(ways: np.ndarray):
    apart = [np.hypot(*np.moveaxis(ways[:, :, i] - ways[:, :, k], -1, 0)) for i in range(COUNT) for k in range(i)]
    assert np.min(apart) > 2 * PERSON_RADIUS_M - 1e-4


def test_people_walk_the_same_bits_alone_and_among_others(ways: np.ndarray):
    alone = np.asarray(walked(inputs(range(3, 4)), jnp.full(2, FAR_M))[1])[:, :, :COUNT]
    np.testing.assert_array_equal(alone[:, 0], ways[:, 3])


def test_people_walk_the_same_bits_on_one_device_and_on_all():
    lanes = 8 * max(device_count(), 2)
    people = inputs(range(lanes))
    robot = Body(jnp.full((lanes, 3), 1.0), jnp.zeros((lanes, 3)), jnp.zeros((lanes, 0)), jnp.zeros((lanes, 3)))

    def places(devices: int) -> np.ndarray:
        own = jax.vmap(lambda own, before, body: walk(own, before, body, HULL_M))
        step, state = jax.jit(split_over(lane_mesh(most=devices), own, 3)), jax.vmap(begin_people)(people)
        ways: list[np.ndarray] = []
        for _ in range(100):
            state = step(people, state, robot)
            ways.append(np.asarray(state.place_m))
        return np.stack(ways)

    np.testing.assert_array_equal(places(1), places(device_count()))


def test_who_does_not_see_the_robot_stops_where_it_touches_it():
    blind = inputs(range(LANES), unaware=1.0)
    begins = np.asarray(blind.place_m[0, 0])
    way = np.roll(blind.corners_m[0, 0, : blind.corner_count[0, 0]], -int(blind.toward[0, 0]), axis=0)
    on_the_way = way[np.argmax(np.hypot(*(way - begins).T) > 1.0)]
    apart = np.hypot(*np.moveaxis(np.asarray(walked(blind, jnp.asarray(on_the_way))[1])[:, 0, 0] - on_the_way, -1, 0))
    assert apart[0] > 1.0 - 0.1
    assert HULL_M + PERSON_RADIUS_M - 0.01 < apart.min() < HULL_M + PERSON_RADIUS_M + 0.01
