"""The window holds the obstacles nearest to the robot, boxes and cylinders alike, nearest first."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.simulate.engines.planar.disc_contact import Obstacle, distance_m, window
from tasks.simulate.geometry.obstacles import obstacles, pad_obstacles
from tests.factories.simulations import cluttered

ALL = pad_obstacles([obstacles(cluttered(3), 0.02, 0.38)])[0]
COUNT = 6
PLACES = {"x": st.floats(-2.3, 6.4), "y": st.floats(-1.8, 1.8)}


def by_hand(x: float, y: float) -> np.ndarray:
    """Returns the distances of all obstacles from a point, boxes first."""
    right, up = x - ALL.boxes[:, 0], y - ALL.boxes[:, 1]
    cos, sin = ALL.boxes[:, 6], ALL.boxes[:, 7]
    beyond = np.abs(np.stack([cos * right + sin * up, cos * up - sin * right])) - ALL.boxes[:, 3:5].T
    round_ones = np.hypot(ALL.cylinders[:, 0] - x, ALL.cylinders[:, 1] - y) - ALL.cylinders[:, 3]
    return np.concatenate([np.hypot(*np.maximum(beyond, 0.0)), round_ones])


def near(x: float, y: float) -> list[Obstacle]:
    return window(jnp.asarray(ALL.boxes), jnp.asarray(ALL.cylinders), jnp.array([x, y], jnp.float32), COUNT)


@settings(max_examples=25)
@given(**PLACES)
def test_no_obstacle_outside_is_nearer_than_one_inside(x: float, y: float):
    held = [float(distance_m([each], jnp.zeros(()), jnp.zeros(()))) for each in near(x, y)]
    np.testing.assert_allclose(held, np.sort(by_hand(x, y))[:COUNT], atol=2e-3)


@settings(max_examples=25)
@given(**PLACES)
def test_the_nearest_of_all_is_known_exactly(x: float, y: float):
    assert float(distance_m(near(x, y), jnp.zeros(()), jnp.zeros(()))) == pytest.approx(by_hand(x, y).min(), abs=1e-5)


def test_an_obstacle_keeps_its_figures_but_for_its_place():
    cylinder = int(np.argmin(np.hypot(*(ALL.cylinders[:, :2] - [2.0, 0.0]).T)))
    x, y, z, radius, half = (float(each) for each in ALL.cylinders[cylinder])
    first = near(x, y)[0]
    assert bool(first.round)
    assert (float(first.x), float(first.y)) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert (float(first.radius), float(first.height), float(first.half_height)) == pytest.approx((radius, z, half))
    assert (float(first.half_x), float(first.half_y)) == (0.0, 0.0)


def test_fewer_obstacles_than_the_window_holds_are_all_in_it():
    boxes, cylinders = jnp.asarray(ALL.boxes[:2]), jnp.asarray(ALL.cylinders[:1])
    assert len(window(boxes, cylinders, jnp.zeros(2), COUNT)) == 3
