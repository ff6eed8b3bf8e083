"""The delivery scenario: where it sends a robot, and how it judges."""

from collections.abc import Callable, Sequence
from typing import cast

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import ks_2samp

from applications.delivery.delivery.rooms import (
    ARRIVED_M,
    HARD_IMPULSE_NS,
    STUCK_S,
    Progress,
    Rooms,
    Verdict,
    _goal_places,
    _ground,
    scenario,
)
from specs.data.world import FloorZone, Rectangle, Route, Start, World
from tasks.results.statistics.particles import Space, plain_particles
from tasks.simulate.application.contract import REASONS, HostMap, Placement, Truth
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.geometry.world_arrays import floor_map
from tests.factories.simulations import cell_of, cluttered, pen

RADIUS_M = 0.18
WORLD, ONE_ROOM = cluttered(2), pen(5.0, 3)


def mapped(world: World) -> HostMap:
    return floor_map(world, obstacles(world, 0.02, 0.38))


FLOORS = {WORLD.name: mapped(WORLD), ONE_ROOM.name: mapped(ONE_ROOM)}


def placed(world: World, seed: int, goals: float = 2) -> Placement:
    return Placement(*Rooms(goals).place(world, FLOORS[world.name], RADIUS_M, np.random.default_rng(seed)))


def room_of(world: World, point: np.ndarray) -> str:
    def holds(floor: Rectangle) -> bool:
        return floor.x_min_m <= point[0] <= floor.x_max_m and floor.y_min_m <= point[1] <= floor.y_max_m

    return next(room.name for room in world.rooms if holds(room.floor))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31))
def test_each_goal_is_free_floor_in_another_room_than_the_one_before(seed: int):
    here = np.zeros(2)
    for goal in placed(WORLD, seed).goals_m:
        assert room_of(WORLD, goal) != room_of(WORLD, here)
        assert FLOORS[WORLD.name].clearance_m[cell_of(FLOORS[WORLD.name], goal)] >= RADIUS_M
        here = goal


def test_a_seed_gives_the_same_episode_and_another_seed_another():
    one, again, other = placed(WORLD, 5), placed(WORLD, 5), placed(WORLD, 6)
    np.testing.assert_array_equal(one.goals_m, again.goals_m)
    np.testing.assert_array_equal(one.start, again.start)
    assert not np.array_equal(one.goals_m, other.goals_m)


def test_in_a_single_room_goals_are_far_apart():
    for seed in range(10):
        here = np.zeros(2)
        for goal in placed(ONE_ROOM, seed).goals_m:
            assert np.hypot(*(goal - here)) > 1.2
            here = goal


def shared(world: World, shares: Sequence[tuple[float, float] | None], goals: float = 2) -> np.ndarray:
    """Returns the goals of shares; those without follow from a seed."""
    return Rooms(goals).place(world, FLOORS[world.name], RADIUS_M, np.random.default_rng(5), shares).goals_m


def test_goals_of_uniform_shares_are_as_likely_as_those_of_seeds():
    for world in (WORLD, ONE_ROOM):
        shares = plain_particles(Space(0, 4), 600, 0, (1,)).drawn.reshape(-1, 2, 2)
        ours = np.array([shared(world, [(x, y) for x, y in each]) for each in shares.tolist()]).reshape(-1, 4)
        seeds = np.array([placed(world, seed).goals_m for seed in range(600)]).reshape(-1, 4)
        assert all(cast("tuple[float, float]", ks_2samp(ours[:, at], seeds[:, at]))[1] > 0.01 for at in range(4))


def test_each_place_of_a_room_has_the_same_part_of_the_shares():
    ground = _ground(WORLD, FLOORS[WORLD.name], RADIUS_M)
    (points,) = _goal_places(ground, np.zeros(2))
    columns, counts = np.unique(points[:, 0], return_counts=True)
    found = list[tuple[float, float]]()
    for column, count in enumerate(counts.tolist()):
        x_share = (counts[:column].sum() + 0.5) / len(points)
        found += [tuple(shared(WORLD, [(x_share, (row + 0.5) / count)], 1)[0]) for row in range(count)]
    assert sorted(found) == sorted(map(tuple, points))
    assert len(columns) > 5


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_little_more_of_a_share_is_a_goal_a_little_further(share: float):
    before = np.array([shared(WORLD, [(share, y)], 1)[0] for y in (0.2, 0.22)])
    assert before[0, 0] == before[1, 0]
    assert 0.0 <= before[1, 1] - before[0, 1] < 0.3
    near = shared(WORLD, [(min(share + 0.01, 1.0), 0.2)], 1)[0]
    assert 0.0 <= near[0] - before[0, 0] < 0.3


def test_goals_without_shares_follow_from_the_seed():
    first, second = shared(WORLD, [None, (0.5, 0.5)])
    np.testing.assert_array_equal(first, placed(WORLD, 5).goals_m[0])
    np.testing.assert_array_equal(shared(WORLD, [(0.5, 0.5), None])[0], shared(WORLD, [(0.5, 0.5)])[0])
    assert not np.array_equal(second, placed(WORLD, 5).goals_m[1])


def test_a_robot_that_fits_nowhere_is_told_so():
    with pytest.raises(ValueError, match=r"no floor for a robot of 3\.00 m radius"):
        Rooms(2).place(WORLD, FLOORS[WORLD.name], 3.0, np.random.default_rng(0))


def test_goals_are_anywhere_in_the_other_room():
    room = WORLD.rooms[1].floor
    first = np.array([placed(WORLD, seed, 1).goals_m[0] for seed in range(200)])
    # The farthest corners of the room are a destination like any other.
    assert first[:, 0].max() > room.x_max_m - 0.4
    assert first[:, 1].min() < room.y_min_m + 0.4
    assert first[:, 1].max() > room.y_max_m - 0.4


@pytest.mark.parametrize("count", [1, 2, 7])
def test_there_are_as_many_goals_as_asked_for(count: int):
    found = placed(WORLD, 3, count)
    assert len(found.goals_m) == count
    assert found.given == (count,)


def test_more_goals_begin_with_those_of_fewer():
    np.testing.assert_array_equal(placed(WORLD, 3, 5).goals_m[:2], placed(WORLD, 3, 2).goals_m)


@pytest.mark.parametrize("goals", [0.0, 1.5, -1.0, 101.0])
def test_a_number_of_goals_that_cannot_be_is_refused(goals: float):
    with pytest.raises(ValueError, match=r"GOALS: .*: must be a whole number from 1 to 100"):
        placed(WORLD, 0, goals)


def test_goals_that_are_no_number_are_refused():
    with pytest.raises(ValueError, match="GOALS: 'many'"):
        scenario({"GOALS": "many"})


SCENARIO = Rooms(2)
STEP: Callable[[Progress, Truth], tuple[Progress, Verdict]] = jax.jit(SCENARIO.step)
GOALS_M = jnp.array([[1.0, 0.0], [0.0, 1.0]])


def truth(time_s: float, x: float, y: float, *, impulse_ns: float = 0.0, inside: bool = True) -> Truth:
    place = jnp.array([x, y, 0.0])
    return Truth(
        jnp.float32(time_s), place, jnp.zeros(3), jnp.float32(0.1), jnp.float32(impulse_ns), jnp.asarray(inside)
    )


def judged(*truths: Truth) -> Verdict:
    # Two goals, filled up as beside an episode that has four.
    state = SCENARIO.init(jnp.zeros(3), jnp.concatenate([GOALS_M, GOALS_M[1:], GOALS_M[1:]]), jnp.int32(2))
    verdict = None
    for each in truths:
        state, verdict = STEP(state, each)
    assert verdict is not None
    return verdict


def test_it_is_passed_when_all_goals_were_reached_in_order():
    first = judged(truth(1.0, 1.0 - 0.9 * ARRIVED_M, 0.0))
    assert (int(first.goal_index), bool(first.done)) == (1, False)
    last = judged(truth(1.0, 1.0, 0.0), truth(2.0, 0.0, 1.0))
    assert (int(last.goal_index), bool(last.done), REASONS[int(last.reason)]) == (2, True, "")


def test_the_second_goal_does_not_count_before_the_first():
    assert int(judged(truth(1.0, 0.0, 1.0)).goal_index) == 0


@pytest.mark.parametrize(
    ("ending", "reason"),
    [
        (truth(1.0, 0.5, 0.0, impulse_ns=2 * HARD_IMPULSE_NS), "collision"),
        (truth(1.0, 9.0, 0.0, inside=False), "out of bounds"),
        (truth(STUCK_S + 0.1, 0.05, 0.0), "stuck"),
    ],
)
def test_it_is_over_with_the_reason(ending: Truth, reason: str):
    verdict = judged(ending)
    assert (bool(verdict.done), REASONS[int(verdict.reason)]) == (True, reason)


def test_brushing_along_something_is_no_collision():
    assert not bool(judged(truth(1.0, 0.5, 0.0, impulse_ns=0.5 * HARD_IMPULSE_NS)).done)


def test_who_moves_on_is_not_stuck():
    steps = [truth(0.5 * k, 0.04 * k, -0.5) for k in range(1, 60)]
    assert not bool(judged(*steps).done)


OWN = ONE_ROOM.model_copy(
    update={
        "version": "2",
        "name": "own",
        "rooms": (),
        "start": Start(x_m=1.2, y_m=-0.7, yaw_rad=0.5),
        "routes": (
            Route(name="round", points_m=((-1.0, -1.0), (1.0, 1.0))),
            Route(name="dock", points_m=((1.5, 1.5),)),
        ),
    }
)
FLOORS[OWN.name] = mapped(OWN)


def routed(route: str, goals: float | None = None) -> Placement:
    return Placement(*Rooms(goals, route).place(OWN, FLOORS["own"], RADIUS_M, np.random.default_rng(0)))


def test_a_route_has_no_shares():
    with pytest.raises(ValueError, match=r"ROUTE: 'dock': says what goals there are"):
        Rooms(None, "dock").place(OWN, FLOORS["own"], RADIUS_M, np.random.default_rng(0), [(0.5, 0.5)])


def test_a_robot_starts_where_its_world_says():
    assert placed(OWN, 3).start.tolist() == [1.2, -0.7, 0.5]


def test_in_a_world_without_rooms_goals_are_anywhere_within_reach():
    goals = np.concatenate([placed(OWN, seed, 7).goals_m for seed in range(40)])
    points = [goals[(goals[:, 0] * x > 0) & (goals[:, 1] * y > 0)] for x in (-1, 1) for y in (-1, 1)]
    assert all(len(some) > 30 for some in points)
    assert np.hypot(*np.diff(placed(OWN, 1, 7).goals_m, axis=0).T).min() >= 1.0


def test_goals_are_in_another_zone_each():
    outlines = {"left": ((-3.0, -3.0), (-0.5, -3.0), (-0.5, 3.0)), "right": ((0.5, -3.0), (3.0, -3.0), (0.5, 3.0))}
    zones = tuple(FloorZone(name=name, outline_m=corners, found=False) for name, corners in outlines.items())
    goals = placed(OWN.model_copy(update={"zones": zones}), 3, 6).goals_m
    held = [zone.holds(*goals.T) for zone in zones]
    assert (held[0] != held[1]).all()
    assert (held[0][1:] != held[0][:-1]).all()


def test_goals_are_those_of_the_route_that_is_named():
    assert routed("round").goals_m.tolist() == [[-1.0, -1.0], [1.0, 1.0]]
    assert routed("round", 1).goals_m.tolist() == [[-1.0, -1.0]]
    assert routed("dock").given[0] == 1


@pytest.mark.parametrize(
    ("route", "goals", "why"),
    [
        ("rond", None, "own: ROUTE: 'rond': must be dock or round"),
        ("round", 3, "GOALS: 3: must be a whole number from 1 to 2"),
    ],
)
def test_a_route_that_is_not_there_is_told(route: str, goals: float | None, why: str):
    with pytest.raises(ValueError, match=why):
        routed(route, goals)


def test_a_start_outside_of_the_map_reaches_nothing():
    away = OWN.model_copy(update={"start": Start(x_m=1e3, y_m=0.0)})
    with pytest.raises(ValueError, match=r"no floor for a robot of 0\.18 m radius around \(1000, 0\)"):
        Rooms(2).place(away, FLOORS["own"], RADIUS_M, np.random.default_rng(0))


def test_a_number_is_no_route():
    with pytest.raises(ValueError, match="ROUTE"):
        scenario({"ROUTE": jnp.float32(3.0)})
