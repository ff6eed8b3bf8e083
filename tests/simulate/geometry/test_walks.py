"""Where people walk in a world, and what is drawn of them."""

import itertools

import numpy as np
import pytest

from specs.data.people import PERSON_HEIGHT_M, PERSON_RADIUS_M, People
from tasks.simulate.geometry.free_floor import clearance_m, solids_of
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.geometry.walks import CORNERS, HostPeople, PeopleRefused, Walks, walks_in
from tests.factories.simulations import cluttered

ROBOT_M, HULL_M = np.zeros(2), 0.2


@pytest.fixture(scope="module")
def walks() -> Walks:
    return walks_in(cluttered(1))


def people(walks: Walks, count: int, seed: int = 3) -> HostPeople:
    return walks.people(People(count=count, unaware=0.5), seed, ROBOT_M, HULL_M)


def test_a_person_has_room_everywhere_on_its_ways(walks: Walks):
    solids = solids_of(obstacles(cluttered(1), 0.05, PERSON_HEIGHT_M))
    for leg in walks.legs.values():
        shares = np.linspace(0.0, 1.0, 50)[:, None]
        points = np.concatenate([one + shares * (other - one) for one, other in itertools.pairwise(leg)])
        assert clearance_m(solids, points).min() > PERSON_RADIUS_M


def test_a_person_is_the_same_whoever_else_there_is(walks: Walks):
    alone, among = people(walks, 1), people(walks, 3)
    for name in ("speed_m_s", "corners_m", "corner_count", "stay_s", "place_m", "patience_s"):
        np.testing.assert_array_equal(getattr(alone, name)[0], getattr(among, name)[0])


def test_another_seed_draws_other_people(walks: Walks):
    assert (people(walks, 2, seed=4).place_m != people(walks, 2).place_m).any()


def test_people_begin_apart_from_one_another_and_from_the_robot(walks: Walks):
    for seed in range(20):
        places = people(walks, 3, seed).place_m[:3].astype(float)
        apart = [np.hypot(*(places[i] - places[k])) for i in range(3) for k in range(i)]
        assert min(apart) > 2 * PERSON_RADIUS_M
        assert np.hypot(*(places - ROBOT_M).T).min() > PERSON_RADIUS_M + HULL_M + 0.9


def test_a_world_without_room_refuses_people_and_says_how_many_fit(walks: Walks):
    with pytest.raises(PeopleRefused, match="people: 2: cluttered-1 has room for 0 people to begin in"):
        walks.people(People(count=2), 0, ROBOT_M, 30.0)


def winding(corners: int) -> Walks:
    """Returns walks between two near places, and to a third one whose way has many corners."""
    found = Walks(cluttered(1))
    near = np.array([[1.0, 1.0], [2.0, 1.0]])
    far = np.stack([np.linspace(1.0, 2.0, corners), np.ones(corners)], axis=1)
    found.__dict__["legs"] = {(0, 1): near, (1, 0): near[::-1]}
    found.legs.update({(0, 2): far, (2, 0): far[::-1], (1, 2): far + 1.0, (2, 1): far[::-1] + 1.0})
    return found


def test_a_person_whose_first_way_has_too_many_corners_takes_a_short_one():
    walks = winding(CORNERS)
    for seed in range(20):
        (count,) = people(walks, 1, seed).corner_count[:1]
        assert 2 <= count <= CORNERS


def test_a_world_whose_ways_all_have_too_many_corners_refuses_people():
    walks = winding(CORNERS)
    del walks.legs[0, 1], walks.legs[1, 0]
    with pytest.raises(PeopleRefused, match=f"no way with at most {CORNERS} corners"):
        people(walks, 1)
