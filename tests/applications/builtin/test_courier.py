"""The courier, its planner and controller, piece by piece; tests of chunks have whole episodes."""

import logging
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import maximum_filter
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from applications.courier.courier.giving_way import nobody, room_of
from applications.courier.courier.go_to_goal import Kept, controller
from applications.courier.courier.planning import RADIUS_M, Ways, cell_of, cell_weight, point_ahead, ways_to_goals
from specs.pipeline.world_sections import WorldImport
from tasks.simulate.application.contract import FloorMap, Observation
from tasks.simulate.engines.mjx.mjx_robot import load_robot
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.geometry.world_arrays import floor_map
from tasks.storage.worlds import decode_world
from tasks.worlds.importer.import_process import import_source
from tests.applications.builtin.drives import COURIER, DELIVERY, drive
from tests.factories.own_worlds import block
from tests.factories.ros_maps import write_map
from tests.factories.simulations import COURIER as COURIER_DIGEST
from tests.factories.simulations import FOLDERS, cluttered, hall
from tests.factories.worlds import apartment

WORLD = apartment()
HOST = floor_map(WORLD, obstacles(WORLD, 0.02, 0.38))
FLOOR = FloorMap(*(jnp.asarray(field) for field in HOST))
GOAL = jnp.array([5.0, 1.2])
PLAN = jax.jit(ways_to_goals)
AHEAD = jax.jit(point_ahead, static_argnames="ahead_m")
WAYS = PLAN(FLOOR, GOAL[None])
OPEN = jnp.full(32, 10.0)
# To its map all that a scan ends on is a solid, and nothing a person.
STATE = Kept(WAYS, room_of(FLOOR._replace(clearance_m=0.0 * FLOOR.clearance_m)), nobody(), None)


def seen(ranges: jax.Array, pose: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Observation:
    nothing, no = jnp.zeros(3), jnp.zeros(0, bool)
    return Observation(jnp.zeros(()), jnp.array(pose), nothing, ranges, jnp.int32(0), GOAL, nothing[:2], no)


def test_its_radius_is_its_hulls():
    assert load_robot(FOLDERS[COURIER_DIGEST] / "robot.xml").hull.radius_m == pytest.approx(RADIUS_M)


@settings(max_examples=25, deadline=None)
@given(st.floats(-1.2, 1.2), st.floats(-0.7, 1.2))
def test_its_way_leads_to_the_goal_without_touching(x: float, y: float):
    place, clearances = jnp.array([x, y]), []
    for _ in range(120):
        place = AHEAD(WAYS, 0, place, 0.1)
        column, row = np.rint((np.asarray(place) - HOST.origin_m) / HOST.cell_m).astype(int)
        clearances.append(HOST.clearance_m[row, column])
    assert np.hypot(*(np.asarray(place) - np.asarray(GOAL))) < 0.1
    assert min(clearances) > RADIUS_M


def test_no_way_costs_less():
    weight = np.asarray(cell_weight(FLOOR.clearance_m))
    row, column = (int(each) for each in cell_of(FLOOR, weight.shape, GOAL))
    least = cheapest(weight, row * weight.shape[1] + column)
    for start in np.argwhere(np.isfinite(least))[::97]:
        assert driven_cost(WAYS, weight, start) == pytest.approx(least[tuple(start)], rel=1e-5)


def cheapest(weight: np.ndarray, goal: int) -> np.ndarray:
    """Returns what it costs to get to a cell from all others, entering none but the start costing nothing."""
    cells, ends, costs = np.arange(weight.size).reshape(weight.shape), [], []
    for row, column in ((0, 1), (1, 0), (1, 1), (1, -1)):
        for sign in (1, -1):
            other = np.roll(cells, (-sign * row, -sign * column), (0, 1))
            # From the goal outwards: the cell that a step leads from is paid for.
            ends.append((other[1:-1, 1:-1].ravel(), cells[1:-1, 1:-1].ravel()))
            costs.append(np.hypot(row, column) * weight[1:-1, 1:-1].ravel())
    edges, values = np.concatenate(ends, axis=1), np.concatenate(costs)
    kept = np.isfinite(values)
    graph = coo_array((values[kept], tuple(edges[:, kept])), shape=(weight.size, weight.size)).tocsr()
    return dijkstra(graph, indices=goal).reshape(weight.shape)


def driven_cost(ways: Ways, weight: np.ndarray, start: np.ndarray) -> float:
    following, (row, column), cost = np.asarray(ways.next_cell[0]), start, 0.0
    steps = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
    while following[row, column] < len(steps):
        down, right = steps[following[row, column]]
        cost += float(np.hypot(down, right) * weight[row, column])
        row, column = row + down, column + right
    return cost


def test_a_walled_off_goal_gives_no_way():
    walled = PLAN(FLOOR._replace(clearance_m=FLOOR.clearance_m.at[:, 78].set(0.0)), GOAL[None])
    np.testing.assert_allclose(AHEAD(walled, 0, jnp.zeros(2), 1.0), jnp.zeros(2), atol=0.051)


def test_a_way_leads_off_what_the_hull_is_too_wide_for():
    # Three cells in niches are the roomiest around: nothing leads off those.
    roomier = maximum_filter(HOST.clearance_m, 3) > HOST.clearance_m
    tight = np.argwhere(roomier & (HOST.clearance_m > 0.0) & (HOST.clearance_m < RADIUS_M - 0.05))
    ahead = [AHEAD(WAYS, 0, jnp.asarray(HOST.origin_m + HOST.cell_m * cell[::-1]), 0.1) for cell in tight[::7]]
    cells = [cell_of(FLOOR, HOST.clearance_m.shape, place) for place in ahead]
    rooms = [HOST.clearance_m[tuple(int(each) for each in cell)] for cell in cells]
    assert all(room > HOST.clearance_m[tuple(cell)] for room, cell in zip(rooms, tight[::7], strict=True))


@pytest.mark.parametrize("wide_m", [1.0, 0.0])
def test_a_gap_as_wide_as_the_hull_is_a_last_resort(wide_m: float):
    """A racetrack's barriers leave such gaps, in which couriers stood until they were stuck."""
    half_m, gap_m = 6.0, 2 * RADIUS_M + 0.006
    spans = [(-half_m, -gap_m / 2), (gap_m / 2, half_m - wide_m)]
    walls = [block(f"between-{low:g}", (2.5, (low + high) / 2), (0.5, high - low)) for low, high in spans]
    world = hall(half_m)
    world = world.model_copy(update={"walls": (*world.walls, *walls)})
    host = floor_map(world, obstacles(world, 0.02, 0.38))
    floor = FloorMap(*(jnp.asarray(field) for field in host))
    ways, place, way_m = PLAN(floor, GOAL[None]), jnp.zeros(2), list[np.ndarray]()
    for _ in range(200):
        place = AHEAD(ways, 0, place, 0.1)
        way_m.append(np.asarray(place))
    assert np.hypot(*(way_m[-1] - np.asarray(GOAL))) < 0.1
    assert (max(y for _, y in way_m) > half_m - wide_m) == (wide_m > 0.0)


@pytest.mark.parametrize(("cell_m", "ahead_m"), [(0.1, 0.6), (0.137, 0.548)])
def test_it_looks_no_farther_ahead_on_wider_cells(cell_m: float, ahead_m: float):
    """On a racetrack's map it cut the corners of piers whose feet lie below its lidar."""
    floor = FloorMap(jnp.ones((144, 144)), jnp.zeros(2), jnp.float32(cell_m), FLOOR.bounds_m)
    place = jnp.full(2, 50 * cell_m)
    ways = PLAN(floor, (place + jnp.array([40 * cell_m, 0.0]))[None])
    np.testing.assert_allclose(AHEAD(ways, 0, place, 0.6) - place, [ahead_m, 0.0], atol=1e-5)


@pytest.mark.parametrize("lanes", [1, 3, 8, 16])
def test_a_plan_is_the_same_bits_among_any_number_of_lanes(lanes: int):
    goals_m = jnp.stack([jnp.array([0.2 * k, 0.0]) for k in range(2 * lanes)]).reshape(lanes, 2, 2)
    together = jax.jit(jax.vmap(ways_to_goals, in_axes=(None, 0)))(FLOOR, goals_m)
    for lane in range(lanes):
        np.testing.assert_array_equal(together.next_cell[lane], PLAN(FLOOR, goals_m[lane]).next_cell)


@pytest.mark.parametrize("limit", [0.2, 0.6])
def test_it_keeps_the_speed_limit(limit: float):
    robot = controller({"MAX_SPEED": jnp.float32(limit)})
    forward = robot.step(STATE, seen(OPEN))[1][0]
    assert 0.0 < float(forward) <= limit * 1.0001


def test_it_stops_before_what_is_straight_ahead():
    robot = controller({"MAX_SPEED": 0.6})
    blocked = OPEN.at[0].set(RADIUS_M + 0.03)
    assert float(robot.step(STATE, seen(blocked))[1][0]) == 0.0


def test_it_turns_on_the_spot_when_the_way_is_behind_it():
    robot = controller({"MAX_SPEED": 0.6})
    forward, turn, _ = robot.step(STATE, seen(OPEN, pose=(0.0, 0.0, 3.0)))[1]
    assert float(forward) < 0.06
    assert abs(float(turn)) > 1.0


@pytest.mark.parametrize("name", ["MAX_SPEED", "LIDAR_SIGMA", "LIDAR_DROPOUT", "ODOMETRY_SIGMA"])
def test_it_asks_for_variables_that_are_numbers(name: str):
    with pytest.raises(ValueError, match=f"{name}: 'much': must be a number"):
        controller({name: "much"})


def test_its_sensors_are_ideal_when_nothing_is_said():
    robot = controller({})
    assert (robot.lidar.sigma_m, robot.lidar.dropout, robot.odometry) == (0.0, 0.0, None)


def test_rays_that_report_nothing_stop_nobody():
    robot = controller({"MAX_SPEED": 0.6})
    near = jnp.full(32, 0.6)
    lost = near.at[::2].set(10.0)
    assert float(robot.step(STATE, seen(near))[1][0]) == float(robot.step(STATE, seen(lost))[1][0]) > 0.0


NOISY = ({"LIDAR_SIGMA": "0.02", "LIDAR_DROPOUT": "0.1", "ODOMETRY_SIGMA": "0.05"},)
WORLDS = {f"hand/apartment-{seed}": cluttered(seed) for seed in range(4)}


@pytest.mark.long
def test_it_delivers_although_its_wheels_miscount():
    rows = drive(COURIER, DELIVERY, WORLDS, NOISY, seeds=4)
    # The goal counts within 0.3 m of its true place.
    assert max(row.odometry_error_m or 0.0 for row in rows) > 0.5
    assert sum(row.outcome == "Passed" for row in rows) >= len(rows) - 1


@pytest.mark.long
def test_a_sweep_over_its_noise_compiles_nothing(caplog: pytest.LogCaptureFixture):
    drive(COURIER, DELIVERY, WORLDS, NOISY, duration_s=2.0)
    others = [dict.fromkeys(NOISY[0], "0"), {**NOISY[0], "LIDAR_SIGMA": "0.3"}]
    with jax.log_compiles(), caplog.at_level(logging.WARNING, logger="jax"):
        rows = drive(COURIER, DELIVERY, WORLDS, others, duration_s=2.0)
        compiled = [record.message for record in caplog.records if "Finished XLA compilation" in record.message]
        jax.jit(lambda x: 5 * x)(1.0)
    assert [row.odometry_error_m == 0.0 for row in rows] == [True] * 4 + [False] * 4
    assert not compiled
    assert any("Finished XLA compilation" in record.message for record in caplog.records)


# Two rooms of 4 m x 4 m, and a door of 1.2 m between them.
ROOMS = (
    "#" * 163,
    *(("#" + "." * 80 + ("." if 28 <= row < 52 else "#") + "." * 80 + "#") for row in range(80)),
    "#" * 163,
)
TOUR = "waypoints: {first: {pose: [7.5, 3.0, 0.0]}, second: {pose: [7.5, 5.2, 0.0]}, third: {pose: [2.5, 5.0, 0.0]}}"


@pytest.mark.long
def test_it_delivers_along_a_route_that_came_with_a_map(tmp_path: Path):
    (tmp_path / "tour.yaml").write_text(TOUR)
    source, routes = str(write_map(tmp_path, ROOMS)), [str(tmp_path / "tour.yaml")]
    asked = WorldImport.model_validate({"name": "rooms", "source": source, "start": [2.5, 3.0], "routes": routes})
    world = decode_world(import_source(asked).world.encode())
    (row,) = drive(COURIER, DELIVERY, {"own/rooms": world}, [{"ROUTE": "tour"}])
    assert (row.outcome, row.goals_reached, row.goals_total) == ("Passed", 3, 3)
    # It was at each of the three places, in their order, to 0.3 m.
    assert row.path_length_m > 5.0 + 2.2 + 5.0 - 5 * 0.3
