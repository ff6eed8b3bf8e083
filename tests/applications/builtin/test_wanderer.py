"""The wanderer: what it makes of a scan, and how it gets on without a map."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from applications.wanderer.wanderer.gaps import along_wall, between, free_ways_m, towards
from applications.wanderer.wanderer.wander import HALF_TRACK_M, RADIUS_M, Lidar, controller
from tasks.simulate.application.contract import Observation
from tasks.simulate.engines.mjx.mjx_robot import load_robot
from tasks.simulate.engines.planar.planar_robot import planar_robot
from tests.applications.builtin.drives import APPLICATIONS, COVERAGE, DELIVERY, WANDERER, drive
from tests.factories.simulations import cluttered

pytestmark = pytest.mark.long

ROBOT = APPLICATIONS / "wanderer" / "robot.xml"
LIDAR = Lidar()
ANGLES = np.linspace(-LIDAR.fov_rad / 2, LIDAR.fov_rad / 2, LIDAR.rays)
HEADINGS = np.linspace(-2.0, 2.0, 41)
OPEN = jnp.full(LIDAR.rays, LIDAR.range_m)
WORLDS = {f"hand/apartment-{seed}": cluttered(seed) for seed in range(4)}


def seen(ranges: jax.Array, goal: tuple[float, float] = (2.0, 0.0), *, bumps: bool = False) -> Observation:
    bumper = jnp.zeros(8, bool).at[0].set(bumps)
    none, speed = jnp.zeros(3), jnp.array([0.3, 0.0, 0.0])
    return Observation(jnp.zeros(()), none, speed, ranges, jnp.int32(0), none[:2], jnp.array(goal), bumper)


def driven(observation: Observation, times: int = 1, **environment: float) -> tuple[float, float]:
    """Returns forward speed and turn rate after some equal observations, a control step apart."""
    robot = controller({name: jnp.float32(value) for name, value in environment.items()})
    mood, control = robot.init(None, jnp.zeros((1, 2))), jnp.zeros(3)
    for step in range(times):
        mood, control = robot.step(mood, observation._replace(time_s=observation.time_s + 0.05 * step))
    left, right, sideways = (float(each) for each in control)
    assert sideways == 0.0
    return (left + right) / 2, (right - left) / (2 * HALF_TRACK_M)


def wall_ahead(distance_m: float) -> jax.Array:
    """Returns the scan of a long wall straight ahead."""
    with np.errstate(divide="ignore"):
        ranges = np.where(np.cos(ANGLES) > 0.0, distance_m / np.cos(ANGLES), np.inf)
    return jnp.asarray(np.minimum(ranges, LIDAR.range_m), jnp.float32)


def test_its_radius_is_its_hulls_and_every_engine_takes_it():
    assert load_robot(ROBOT).hull.radius_m == pytest.approx(RADIUS_M)
    assert planar_robot(ROBOT).hull.radius_m == pytest.approx(RADIUS_M)


def test_a_way_is_free_as_far_as_the_disc_gets_without_touching():
    free = free_ways_m(wall_ahead(1.0), ANGLES, np.array([0.0, 1.0, 2.0]), 0.2, LIDAR.range_m)
    assert float(free[0]) == pytest.approx(0.8, abs=0.01)
    assert float(free[1]) == pytest.approx(0.8 / np.cos(1.0), abs=0.05)
    assert float(free[2]) == LIDAR.range_m


def test_a_gap_narrower_than_the_hull_is_no_way():
    narrow = wall_ahead(1.0).at[29:32].set(LIDAR.range_m)
    wide = wall_ahead(1.0).at[22:39].set(LIDAR.range_m)
    free = [float(free_ways_m(each, ANGLES, np.zeros(1), 0.2, LIDAR.range_m)[0]) for each in (narrow, wide)]
    assert free[0] < 1.0
    assert free[1] == LIDAR.range_m


def test_lost_rays_are_in_nobodys_way():
    assert float(free_ways_m(OPEN, ANGLES, np.zeros(1), 0.2, LIDAR.range_m)[0]) == LIDAR.range_m


def test_of_two_open_headings_it_takes_the_one_nearer_to_its_wish():
    is_open = jnp.asarray((np.abs(HEADINGS + 1.0) < 0.01) | (np.abs(HEADINGS - 0.5) < 0.01))
    assert HEADINGS[int(towards(jnp.float32(0.2), is_open, HEADINGS))] == pytest.approx(0.5)
    assert HEADINGS[int(towards(jnp.float32(-1.5), is_open, HEADINGS))] == pytest.approx(-1.0)


@pytest.mark.parametrize("side", [1, -1])
def test_a_wall_is_kept_on_the_side_that_it_is_followed_on(side: int):
    ranges = wall_ahead(0.5)
    is_open = free_ways_m(ranges, ANGLES, HEADINGS, 0.2, LIDAR.range_m) > 0.6
    heading = HEADINGS[int(along_wall(jnp.int32(side), ranges, ANGLES, is_open, HEADINGS))]
    assert -side * heading == pytest.approx(1.05, abs=0.1)


def test_the_turn_between_two_directions_is_the_shorter_one():
    assert float(between(jnp.float32(3.0), jnp.float32(-3.0))) == pytest.approx(6.0 - 2 * np.pi, abs=1e-5)


def test_it_goes_straight_to_a_goal_in_the_open():
    forward, turn = driven(seen(OPEN), MAX_SPEED=0.4)
    assert forward == pytest.approx(0.4, abs=0.01)
    assert abs(turn) < 0.2


def test_it_turns_towards_a_goal_on_its_left():
    assert driven(seen(OPEN, goal=(0.5, 2.0)))[1] > 1.0


def test_it_stops_before_what_is_straight_ahead():
    assert driven(seen(wall_ahead(RADIUS_M + 0.02)))[0] <= 0.0


def test_it_backs_off_from_what_it_runs_into():
    assert driven(seen(OPEN))[0] > 0.0
    assert driven(seen(OPEN, bumps=True))[0] < 0.0


def test_it_does_something_else_when_nothing_moves():
    still = seen(wall_ahead(0.2))._replace(velocity=jnp.zeros(3))
    assert driven(still, times=45)[0] < 0.0


def test_one_that_does_not_seek_does_not_mind_where_the_goal_is():
    left, right = (driven(seen(OPEN, goal=goal), SEEK=0.0) for goal in ((0.0, 2.0), (0.0, -2.0)))
    assert left == right


@pytest.mark.parametrize("name", ["MAX_SPEED", "SEEK", "LIDAR_SIGMA", "LIDAR_DROPOUT"])
def test_it_asks_for_variables_that_are_numbers(name: str):
    with pytest.raises(ValueError, match=f"{name}: 'much': must be a number"):
        controller({name: "much"})


@pytest.mark.long
def test_it_gets_through_a_door_without_a_map():
    rows = drive(WANDERER, DELIVERY, WORLDS, [{"MAX_SPEED": "0.4"}], seeds=4, duration_s=120.0)
    assert all(row.status == "Completed" for row in rows)
    assert sum(row.goals_reached for row in rows) >= len(rows)
    assert sum(row.outcome == "Passed" for row in rows) >= len(rows) // 3


@pytest.mark.long
@pytest.mark.parametrize("seek", ["0", "1"])
def test_it_sees_most_of_the_floor_with_and_without_being_told_where(seek: str):
    rows = drive(WANDERER, COVERAGE, WORLDS, [{"SEEK": seek}], seeds=4, duration_s=120.0)
    assert np.mean([row.metrics["covered_share"] for row in rows]) > 0.6
