"""What reaches a controller: the declared sensors, from where they are mounted, as far as they drifted."""

from collections.abc import Mapping
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tasks.simulate.application.contract import Body, FloorMap, Motion, Observation, Work
from tasks.simulate.geometry.hull_distance import LaneObstacles
from tasks.simulate.geometry.lidar_scan import LidarOutlines
from tasks.simulate.lane.chunk_applications import Applications
from tasks.simulate.lane.control_step import EpisodeTotals, LaneInputs, LaneState, feel, observe
from tasks.simulate.sensors.sensor import seed_words
from tasks.simulate.sensors.sensor_table import read_sensors

pytestmark = pytest.mark.long

RANGE_M = 5.0
LIDAR = {"rays": 4, "range_m": RANGE_M, "height_m": 0.2}
# One wall 2 m ahead of the origin, 0.2 m thick; the rest is parked far away.
WALL = jnp.tile(jnp.array([1000.0, 1000.0, 0.05, 0.05]), (8, 1)).at[0].set(jnp.array([2.1, 0.0, 0.1, 3.0]))
SEEN = LidarOutlines(
    WALL,
    jnp.zeros((8, 6)).at[:, :2].set(1000.0),
    jnp.zeros((8, 3)).at[:, :2].set(1000.0),
    *(jnp.zeros((0, columns)) for columns in (14, 20, 26)),
    counts=jnp.array([1, 0, 0, 0, 0, 0]),
)


def applications(**sensors: Mapping[str, object]) -> Applications:
    def make(_: Mapping[str, object]) -> SimpleNamespace:
        return SimpleNamespace(**{name: SimpleNamespace(**values) for name, values in sensors.items()})

    return Applications(make, SimpleNamespace, {}, (), read_sensors(make, {}))


def inputs() -> LaneInputs:
    return LaneInputs(
        obstacles=LaneObstacles(jnp.zeros((1, 8)), jnp.zeros((1, 5)), jnp.zeros((0, 20))),
        lidar_outlines=SEEN,
        floor=FloorMap(jnp.zeros((2, 2)), jnp.zeros(2), jnp.ones(()), jnp.zeros(4)),
        start=jnp.zeros(3),
        goals_m=jnp.array([[1.0, 0.0], [1.0, 3.0]]),
        given=(),
        seed=jnp.asarray(seed_words(3)),
        numbers=jnp.zeros(0),
        last_step=jnp.int32(100),
        alive=jnp.ones((), bool),
    )


def state(pose: tuple[float, float, float], believed: tuple[float, float, float] | None = None) -> LaneState:
    zero, none = jnp.zeros(()), jnp.zeros((), jnp.int32)
    at, thought = jnp.array(pose), None if believed is None else jnp.array(believed)
    return LaneState(
        body=Body(at, jnp.array([0.5, 0.0, 0.1]), jnp.zeros(0), jnp.zeros(3)),
        sensed={
            "lidar": (),
            "odometry": thought,
            "bumper": jnp.zeros(0, bool),
            "depth_camera": None,
            "imu": None,
            "range_finders": (),
        },
        controller=(),
        scenario=(),
        metrics={},
        totals=EpisodeTotals(zero, none, none > 0, zero, zero, zero, zero),
        step=none,
        goal_index=jnp.int32(1),
        goal_steps=jnp.zeros(2, jnp.int32),
        done=none > 0,
        reason=none,
        crash=none,
    )


def motion(pose: tuple[float, float, float], push: tuple[float, float] = (0.0, 0.0)) -> Motion:
    body = Body(jnp.array(pose), jnp.zeros(3), jnp.zeros(0), jnp.zeros(3))
    return Motion(body, Work(jnp.float32(np.hypot(*push)), jnp.array(push), jnp.zeros(())), jnp.zeros(()))


def sensed(robot: Applications, lane: LaneState) -> Observation:
    return jax.jit(lambda given, lane: observe(robot, given, lane))(inputs(), lane)


def test_the_lidar_looks_from_where_it_is_mounted():
    ahead = sensed(applications(lidar=LIDAR), state((0.0, 0.0, 0.0)))
    np.testing.assert_allclose(ahead.ranges_m, [2.0, RANGE_M, RANGE_M, RANGE_M], atol=1e-4)
    forward = sensed(applications(lidar={**LIDAR, "x_m": 0.3}), state((0.0, 0.0, 0.0)))
    np.testing.assert_allclose(forward.ranges_m, [1.7, RANGE_M, RANGE_M, RANGE_M], atol=1e-4)
    # The robot looks to the left, and its lidar, on its right side, to the robot's right.
    turned = sensed(applications(lidar={**LIDAR, "y_m": -0.3, "yaw_rad": -np.pi / 2}), state((0.0, 0.0, np.pi / 2)))
    np.testing.assert_allclose(turned.ranges_m, [1.7, RANGE_M, RANGE_M, RANGE_M], atol=1e-4)


def test_a_robot_without_sensors_gets_empty_ones():
    found = sensed(applications(), state((0.0, 0.0, 0.0)))
    assert found.ranges_m.shape == found.bumper.shape == (0,)


def test_the_goal_is_told_in_the_robots_frame():
    found = sensed(applications(), state((1.0, 1.0, np.pi / 2)))
    np.testing.assert_allclose(found.goal_m, [1.0, 3.0])
    np.testing.assert_allclose(found.goal_robot_m, [2.0, 0.0], atol=1e-6)


def test_with_odometry_the_believed_pose_replaces_the_true_one():
    robot = applications(odometry={"sigma_m_per_m": 0.1})
    found = sensed(robot, state((0.0, 0.0, 0.0), believed=(1.0, 1.0, np.pi / 2)))
    np.testing.assert_allclose(found.pose, [1.0, 1.0, np.pi / 2])
    np.testing.assert_allclose(found.goal_robot_m, [2.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(found.velocity, [0.0, 0.5, 0.1], atol=1e-6)  # forwards, as it sees itself


def test_the_lidar_sees_from_the_true_pose():
    robot = applications(lidar=LIDAR, odometry={"sigma_m_per_m": 0.1})
    found = sensed(robot, state((0.5, 0.0, 0.0), believed=(0.0, 0.0, 1.0)))
    assert float(found.ranges_m[0]) == pytest.approx(1.5, abs=1e-4)


def test_odometry_drifts_while_the_robot_drives():
    robot = applications(odometry={"sigma_m_per_m": 0.1})
    felt = feel(robot, inputs(), state((0.0, 0.0, 0.0), believed=(0.0, 0.0, 0.0)), motion((0.05, 0.0, 0.0)))
    assert felt["odometry"] is not None
    assert 1e-4 < abs(float(felt["odometry"][0]) - 0.05) < 0.1


def test_without_odometry_the_robot_knows_its_pose():
    assert feel(applications(), inputs(), state((0.0, 0.0, 0.0)), motion((0.05, 0.1, 0.2)))["odometry"] is None
    np.testing.assert_allclose(sensed(applications(), state((0.05, 0.1, 0.2))).pose, [0.05, 0.1, 0.2])


@pytest.mark.parametrize(
    ("push", "yaw_rad", "sector"),
    [
        ((-1.0, 0.0), 0.0, 0),  # hit from the front
        ((0.0, -1.0), 0.0, 1),  # from the left
        ((1.0, 0.2), 0.0, 2),  # from behind
        ((0.0, 1.0), 0.0, 3),
        ((0.0, -1.0), np.pi / 2, 0),
        ((-1.0, 0.0), np.pi, 2),
        ((-1.0, 0.0), 7 * np.pi, 2),
    ],
)
def test_the_bumper_tells_which_side_was_touched(push: tuple[float, float], yaw_rad: float, sector: int):
    robot = applications(bumper={"sectors": 4})
    felt = feel(robot, inputs(), state((0.0, 0.0, yaw_rad)), motion((0.0, 0.0, yaw_rad), push))
    assert felt["bumper"].tolist() == [k == sector for k in range(4)]


def test_the_bumper_is_silent_without_contact():
    felt = feel(applications(bumper={"sectors": 4}), inputs(), state((0.0, 0.0, 0.0)), motion((0.0, 0.0, 0.0)))
    assert not felt["bumper"].any()
