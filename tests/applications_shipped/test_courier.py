"""The courier's planner and controller, piece by piece; whole episodes are in tests/simulate/test_runner.py."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from applications.courier.courier.go_to_goal import GoToGoal, Plan, controller
from applications.courier.courier.planning import RADIUS_M, cost_to_goal, point_ahead
from tasks.simulate.contract import FloorMap, Observation
from tasks.simulate.floor_map import floor_map
from tasks.simulate.model import load_robot
from tasks.simulate.obstacles import obstacles
from tests.simulate_factory import COURIER, FOLDERS
from tests.worlds_factory import apartment

WORLD = apartment()
HOST = floor_map(WORLD, obstacles(WORLD, 0.02, 0.38), 128)
FLOOR = FloorMap(*(jnp.asarray(field) for field in HOST))
GOAL = jnp.array([5.0, 1.2])
PLAN = jax.jit(cost_to_goal)
AHEAD = jax.jit(point_ahead, static_argnames="cells")
COST = PLAN(FLOOR, GOAL)
OPEN = jnp.full(32, 10.0)
STATE = Plan(FLOOR, COST[None])


def seen(ranges: jax.Array, pose: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Observation:
    nothing, no = jnp.zeros(3), jnp.zeros(0, bool)
    return Observation(jnp.zeros(()), jnp.array(pose), nothing, ranges, jnp.int32(0), GOAL, nothing[:2], no)


def test_its_radius_is_its_hulls():
    assert load_robot(FOLDERS[COURIER] / "robot.xml").hull.radius_m == pytest.approx(RADIUS_M)


@settings(max_examples=25, deadline=None)
@given(st.floats(-1.2, 1.2), st.floats(-0.7, 1.2))
def test_going_downhill_leads_to_the_goal_without_touching(x: float, y: float):
    place, clearances = jnp.array([x, y]), []
    for _ in range(120):
        place = AHEAD(FLOOR, COST, place, 1)
        column, row = np.rint((np.asarray(place) - HOST.origin_m) / HOST.cell_m).astype(int)
        clearances.append(HOST.clearance_m[row, column])
    assert np.hypot(*(np.asarray(place) - np.asarray(GOAL))) < 0.1
    assert min(clearances) > RADIUS_M


def test_a_walled_off_goal_gives_no_way_and_no_nonsense():
    walled = FLOOR._replace(clearance_m=FLOOR.clearance_m.at[:, 78].set(0.0))
    cost = PLAN(walled, GOAL)
    assert bool(jnp.isfinite(cost).all())
    assert bool(jnp.all(AHEAD(walled, cost, jnp.zeros(2), 10) == AHEAD(walled, cost, jnp.zeros(2), 1)))


@pytest.mark.parametrize("limit", [0.2, 0.6])
def test_it_keeps_the_speed_limit(limit: float):
    robot = controller({"MAX_SPEED": jnp.float32(limit)})
    forward = robot.step(STATE, seen(OPEN))[1][0]
    assert 0.0 < float(forward) <= limit * 1.0001


def test_it_stops_before_what_is_straight_ahead():
    robot = GoToGoal(0.6)
    blocked = OPEN.at[0].set(RADIUS_M + 0.03)
    assert float(robot.step(STATE, seen(blocked))[1][0]) == 0.0


def test_it_turns_on_the_spot_when_the_way_is_behind_it():
    robot = GoToGoal(0.6)
    forward, turn, _ = robot.step(STATE, seen(OPEN, pose=(0.0, 0.0, 3.0)))[1]
    assert float(forward) < 0.06
    assert abs(float(turn)) > 1.0


def test_it_asks_for_a_speed_limit_that_is_a_number():
    with pytest.raises(ValueError, match="MAX_SPEED: 'fast'"):
        controller({"MAX_SPEED": "fast"})
