"""How people walk: never into furniture, never stuck, the same alone and among others, and stopped by a robot."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from specs.data.episode import CONTROL_S
from specs.data.people import PERSON_HEIGHT_M, PERSON_RADIUS_M, People
from specs.data.world import Solid, World
from tasks.simulate.application.contract import Body
from tasks.simulate.devices import device_count
from tasks.simulate.engines.program import lane_mesh, split_over
from tasks.simulate.geometry.free_floor import clearance_m, solids_of
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.geometry.walks import HostPeople, walks_in
from tasks.simulate.lane.walkers import PeopleInputs, PeopleState, begin_people, robot_disc, walk
from tests.factories.simulations import cluttered, hall

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
    body = robot_disc(robot_m, jnp.zeros(2), HULL_M)

    def step(state: PeopleState, _: None) -> tuple[PeopleState, jax.Array]:
        after = jax.vmap(lambda own, before: walk(own, before, [body]))(people, state)
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
        own = jax.vmap(lambda own, before, body: walk(own, before, [robot_disc(body.qpos, body.qvel, HULL_M)]))
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


def test_who_does_not_see_robots_stops_where_it_touches_either_of_two():
    """They stand side by side, with less room between them than a person needs."""
    bare = walks_in(hall(4.0)).people(People(count=1, unaware=1.0), 1, np.full(2, FAR_M), HULL_M)
    corners_m = np.zeros_like(bare.corners_m)
    corners_m[0, :2] = [(-1.0, 0.0), (4.0, 0.0)]
    bare = bare._replace(
        corners_m=corners_m,
        corner_count=np.full(4, 2, np.int32),
        stay_s=np.ones_like(bare.stay_s),
        toward=np.ones(4, np.int32),
        place_m=corners_m[:, 0],
    )
    people = PeopleInputs(*jax.tree.map(jnp.asarray, bare))
    gate_m = np.array([[2.0, HULL_M + 0.15], [2.0, -HULL_M - 0.15]])
    robots = [robot_disc(jnp.asarray(place_m), jnp.zeros(2), HULL_M) for place_m in gate_m]

    def step(state: PeopleState, _: None) -> tuple[PeopleState, jax.Array]:
        after = walk(people, state, robots)
        return after, after.place_m[0]

    way = np.asarray(jax.jit(lambda: jax.lax.scan(step, begin_people(people), None, length=400))()[1])
    apart_m = np.hypot(*np.moveaxis(way[:, None] - gate_m, -1, 0)) - HULL_M - PERSON_RADIUS_M
    assert -0.01 < apart_m.min() < 0.01
    assert (apart_m.min(axis=0) < 0.01).all()


def narrow(west_m: float, east_m: float, width_m: float) -> World:
    """Returns a hall that is so narrow, about its middle line, between two places along x."""
    bare, half_m = hall(2.0), 2.0
    thick, middle = (half_m - width_m / 2) / 2, (half_m + width_m / 2) / 2
    sides = [
        Solid(
            name=f"block{side:+g}",
            shape="box",
            center_m=((west_m + east_m) / 2, side * middle, 0.5),
            half_extents_m=((east_m - west_m) / 2, thick, 0.5),
            yaw_rad=0.0,
            color=(0.5, 0.5, 0.5),
        )
        for side in (-1.0, 1.0)
    ]
    return bare.model_copy(update={"walls": (*bare.walls, *sides)})


def between(world: World, seed: int, rounds: np.ndarray) -> HostPeople:
    """Returns people who walk to and fro between two places each, from their first ones on."""
    count = len(rounds)
    drawn = walks_in(world).people(People(count=count), seed, np.full(2, FAR_M), HULL_M)
    corners_m, stay_s = np.zeros_like(drawn.corners_m), np.zeros_like(drawn.stay_s)
    corner_count, place_m = np.ones_like(drawn.corner_count), drawn.place_m.copy()
    corners_m[:count, :2], place_m[:count], corner_count[:count] = rounds, rounds[:, 0], 2
    stay_s[:count, :2] = np.random.default_rng(seed).uniform(2.0, 10.0, (count, 2))
    return drawn._replace(
        corners_m=corners_m,
        corner_count=corner_count,
        stay_s=stay_s,
        toward=np.ones_like(drawn.toward),
        place_m=place_m,
    )


def test_who_is_in_a_niche_comes_out_though_three_want_in():
    """Each turned back after its own patience and soon came again, so that hardly ever all wanted out of it at once."""
    world, inside = narrow(-2.5, -1.0, 1.0), (-2.1, 0.0)
    outside = [(2.0, 0.0), (0.5, 1.0), (0.5, -1.0), (1.0, 0.0)]
    rounds = np.array([[inside, outside[0]], *([place, inside] for place in outside[1:])])
    people = [between(world, seed, rounds) for seed in range(LANES)]
    lanes = PeopleInputs(*jax.tree.map(lambda *parts: jnp.stack([*map(jnp.asarray, parts)]), *people))
    ways = np.asarray(walked(lanes, jnp.full(2, FAR_M))[1])
    span = round(40.0 / CONTROL_S)
    for first in range(0, STEPS - span, 20):
        part = ways[first : first + span]
        assert np.hypot(*np.moveaxis(np.ptp(part, axis=0), -1, 0)).min() > 0.3


def test_two_who_go_their_ways_leave_room_for_turning_back():
    """Those who touched each other and two walls at once could not move at all, whichever of them turned back."""
    world = narrow(-0.5, 5.5, 0.8)
    rounds = np.array([[(1.5, 0.0), (7.0, 0.0)], [(3.5, 0.0), (-2.0, 0.0)]])
    two = between(world, 1, rounds)._replace(patience_s=np.full(4, 6.0, np.float32))
    lane = PeopleInputs(*jax.tree.map(lambda part: jnp.asarray(part)[None], two))
    places = np.asarray(walked(lane, jnp.full(2, FAR_M))[1])[:, 0]
    apart = np.hypot(*(places[:, 0] - places[:, 1]).T)
    assert apart[:100].min() == pytest.approx(2 * PERSON_RADIUS_M + 0.1, abs=0.02)
    assert apart.min() >= 2 * PERSON_RADIUS_M - 1e-4


def test_who_turns_back_before_it_has_left_its_place_clears_that_place():
    """It went back to where it stood, and so stood there for as long as its way was blocked."""
    here, blocked, clear = (2.5, 0.0), (4.5, 0.0), (0.5, 0.0)
    drawn = between(narrow(-0.5, 5.5, 0.8), 1, np.array([[here, blocked]]))
    corners_m, stay_s, corner_count = drawn.corners_m.copy(), drawn.stay_s.copy(), drawn.corner_count.copy()
    corners_m[0, :3], stay_s[0, :3], corner_count[0] = (here, blocked, clear), 5.0, 3
    hasty = {"patience_s": np.full(4, 2.0, np.float32), "speed_m_s": np.full(4, 0.6, np.float32)}
    one = drawn._replace(corners_m=corners_m, stay_s=stay_s, corner_count=corner_count, **hasty)
    lane = PeopleInputs(*jax.tree.map(lambda part: jnp.asarray(part)[None], one))
    robot_m = jnp.array([here[0] + HULL_M + PERSON_RADIUS_M + 0.02, 0.0])
    way = np.asarray(walked(lane, robot_m)[1])[: round(30.0 / CONTROL_S), 0, 0]
    assert way[:, 0].max() < here[0] + 0.1
    assert abs(way[:, 0].min() - clear[0]) < 0.3
