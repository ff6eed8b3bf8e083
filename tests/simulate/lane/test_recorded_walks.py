"""People who do recorded walks again are where these say, and wait while a robot stands there."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from specs.data.people import PERSON_RADIUS_M, People
from specs.data.world import RecordedWalk
from tasks.simulate.geometry.walks import PeopleRefused, walks_in
from tasks.simulate.lane.walkers import PeopleInputs, PeopleState, begin_people, robot_disc, walk
from tests.factories.simulations import pen

HULL_M, STEPS, FAR = 0.2, 1200, np.array([50.0, 50.0])
RNG = np.random.default_rng(3)
WANDERING = RecordedWalk(
    name="wandering",
    times_s=tuple(np.cumsum(RNG.uniform(0.2, 2.0, 60)).tolist()),
    points_m=tuple(map(tuple, np.cumsum(RNG.uniform(-0.5, 0.5, (60, 2)), axis=0).tolist())),
)
ROUND = RecordedWalk(name="round", times_s=(0.0, 4.0, 8.0), points_m=((0.0, 0.0), (4.0, 0.0), (0.0, 0.0)), period_s=8.0)
RECORDED = People(count=2, model="recorded")


def people_of(*walks: RecordedWalk, robot_m: np.ndarray = FAR) -> PeopleInputs:
    world = pen(4.5, 0).model_copy(update={"walks": walks})
    found = walks_in(world).people(RECORDED, 0, robot_m, HULL_M)
    return PeopleInputs(*jax.tree.map(jnp.asarray, found))


def driven(people: PeopleInputs, robot_m: np.ndarray = FAR) -> np.ndarray:
    """Returns where people are after each control step of a minute."""
    robot = robot_disc(jnp.asarray(robot_m, jnp.float32), jnp.zeros(2), HULL_M)

    def step(state: PeopleState, _: None) -> tuple[PeopleState, jax.Array]:
        after = walk(people, state, [robot])
        return after, after.place_m

    return np.asarray(jax.jit(lambda: jax.lax.scan(step, begin_people(people), None, length=STEPS))()[1])


def interpolated(walk: RecordedWalk, times_s: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(times_s, walk.times_s, axis) for axis in np.transpose(walk.points_m)], axis=1)


def test_recorded_walks_are_reproduced_within_a_centimetre():
    ways, times_s = driven(people_of(WANDERING, ROUND)), 0.05 * np.arange(1, STEPS + 1)
    assert np.abs(ways[:, 0] - interpolated(WANDERING, times_s)).max() < 1e-3
    assert np.abs(ways[:, 1] - interpolated(ROUND, times_s % 8.0)).max() < 1e-3
    assert ways[:, 2:].min() > 500.0


def test_who_would_walk_into_the_robot_waits_and_goes_on_later():
    ways = driven(people_of(WANDERING, ROUND), np.array([2.0, 0.0]))[:, 1]
    apart_m = np.hypot(*(ways - np.array([2.0, 0.0])).T)
    assert HULL_M + PERSON_RADIUS_M - 0.01 < apart_m.min() < HULL_M + PERSON_RADIUS_M + 0.06
    np.testing.assert_array_equal(ways[-1], ways[60])


def test_a_world_with_too_few_walks_is_refused():
    with pytest.raises(PeopleRefused, match="has 1 recorded walks"):
        people_of(ROUND)


def test_a_walk_that_begins_where_the_robot_does_is_refused():
    with pytest.raises(PeopleRefused, match="round begins where the robot does"):
        people_of(WANDERING, ROUND, robot_m=np.array([0.1, 0.0]))
