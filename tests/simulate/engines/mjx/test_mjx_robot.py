"""The window holds the nearest obstacles, and the model gets them."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.simulate.engines.mjx.mjx_robot import (
    BOX_SLOTS,
    RobotModel,
    load_robot,
    nearest_obstacles,
    with_window,
)
from tasks.simulate.geometry.hull_distance import LaneObstacles, hull_distance_m
from tasks.simulate.geometry.hull_outline import HullPart
from tasks.simulate.geometry.obstacles import obstacles, pad_obstacles
from tests.factories.simulations import COURIER, FOLDERS, cluttered

OBSTACLES = pad_obstacles([obstacles(cluttered(3), 0.02, 0.38)])[0]
AROUND = LaneObstacles(*map(jnp.asarray, OBSTACLES))


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return load_robot(FOLDERS[COURIER] / "robot.xml")


def to_box(box: np.ndarray, x: float, y: float) -> float:
    """Returns the distance by looking at points of the box one by one."""
    along = np.linspace(-1.0, 1.0, 201)
    u, v = np.meshgrid(along * box[3], along * box[4])
    return float(np.hypot(box[0] + box[6] * u - box[7] * v - x, box[1] + box[7] * u + box[6] * v - y).min())


@settings(max_examples=25, deadline=None)
@given(st.floats(-2.3, 6.4), st.floats(-1.8, 1.8))
def test_no_obstacle_outside_the_window_is_nearer_than_one_inside(x: float, y: float):
    window, _ = nearest_obstacles(AROUND, jnp.array([x, y]))
    real = OBSTACLES.boxes[OBSTACLES.boxes[:, 0] < 500]
    all_distances = np.sort([to_box(box, x, y) for box in real])
    held = np.sort([to_box(np.asarray(box), x, y) for box in window.boxes])
    np.testing.assert_allclose(held, all_distances[:BOX_SLOTS], atol=0.02)


@settings(max_examples=25, deadline=None)
@given(st.floats(-2.3, 6.4), st.floats(-1.8, 1.8))
def test_the_nearest_obstacle_of_all_is_in_the_window(x: float, y: float):
    window, _ = nearest_obstacles(AROUND, jnp.array([x, y]))
    round_ones = np.hypot(OBSTACLES.cylinders[:, 0] - x, OBSTACLES.cylinders[:, 1] - y) - OBSTACLES.cylinders[:, 3]
    boxes = min(to_box(box, x, y) for box in OBSTACLES.boxes if box[0] < 500)
    point = HullPart(np.zeros((1, 2)), 0.0, 0.0, 1.0)
    found = hull_distance_m([point], window, jnp.array([x, y, 0.0]))
    assert float(found) == pytest.approx(min(boxes, round_ones.min()), abs=0.02)


def test_the_model_gets_the_windows_obstacles_in_its_slots(robot: RobotModel):
    window, _ = nearest_obstacles(AROUND, jnp.array([5.2, -0.8]))
    model = with_window(robot, window)
    np.testing.assert_allclose(model.geom_pos[robot.box_slots], window.boxes[:, :3])
    np.testing.assert_allclose(model.geom_size[robot.cylinder_slots][:, :2], window.cylinders[:, 3:5])
    turned = int(np.flatnonzero(np.asarray(window.boxes[:, 7]) > 0.1)[0])
    w, _, _, z = np.asarray(model.geom_quat[robot.box_slots[turned]])
    assert 2 * np.arctan2(z, w) == pytest.approx(
        np.arctan2(float(window.boxes[turned, 7]), float(window.boxes[turned, 6])), abs=1e-6
    )


def test_the_robots_own_geoms_stay_as_they_are(robot: RobotModel):
    window, _ = nearest_obstacles(AROUND, jnp.zeros(2))
    hull = robot.host.geom("hull").id
    np.testing.assert_array_equal(with_window(robot, window).geom_size[hull], robot.model.geom_size[hull])
