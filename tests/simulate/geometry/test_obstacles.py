"""Worlds become arrays of the solids at the robot's height, of few different sizes."""

import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest

from tasks.simulate.geometry.lidar_scan import LidarOutlines, scan_ranges
from tasks.simulate.geometry.obstacles import PARKING_M, obstacles, pad_obstacles
from tests.factories.simulations import cluttered, pen, with_wedges
from tests.factories.worlds import apartment


def test_only_solids_in_the_band_of_heights_are_kept():
    low = obstacles(apartment(), 0.02, 0.38)
    high = obstacles(apartment(), 2.2, 2.3)
    # 6 walls, the sofa's seat and the table are low; the lintel, and the walls, are high.
    assert len(low.boxes) == 8
    assert len(low.cylinders) == 2
    assert len(high.boxes) == 7
    assert len(high.cylinders) == 0


def test_a_prisms_corners_are_turned_and_the_last_one_is_repeated():
    (wedge,) = with_wedges(pen(6.0, 3), 3).furniture[0].solids
    found = obstacles(with_wedges(pen(6.0, 3), 3), 0.02, 0.38).prisms[0]
    turned = np.array(wedge.outline_m) @ [1.0, 1.0j] * np.exp(1j * wedge.yaw_rad)
    corners = found[4:].reshape(-1, 2) @ [1.0, 1.0j]
    np.testing.assert_allclose(found[:4], [*wedge.center_m, wedge.half_extents_m[2]], rtol=1e-6)
    np.testing.assert_allclose(corners[: len(turned)], turned, atol=1e-6)
    assert (corners[len(turned) :] == corners[len(turned) - 1]).all()


def test_worlds_without_prisms_have_no_places_for_them():
    plain, wedged = obstacles(pen(6.0, 3), 0.02, 0.38), obstacles(with_wedges(pen(6.0, 3), 3), 0.02, 0.38)
    assert len(pad_obstacles([plain])[0].prisms) == 0
    assert [len(each.prisms) for each in pad_obstacles([plain, wedged])] == [32, 32]


def test_a_solid_that_only_touches_the_band_is_left_out():
    assert len(obstacles(apartment(), 0.08, 0.2).cylinders) == 1  # the lamp's pole; its foot ends at 0.08 m


def test_padding_keeps_the_solids_and_parks_the_rest_far_away():
    few, many = (obstacles(world, 0.02, 0.38) for world in (apartment(), cluttered(1)))
    first, second = pad_obstacles([few, many])
    assert first.boxes.shape == second.boxes.shape
    assert first.cylinders.shape == second.cylinders.shape
    np.testing.assert_array_equal(first.boxes[: len(few.boxes)], few.boxes)
    assert (np.abs(first.boxes[len(few.boxes) :, :2]) >= PARKING_M).all()
    assert (np.abs(first.cylinders[len(few.cylinders) :, :2]) >= PARKING_M).all()


def test_another_world_does_not_change_the_shapes():
    alone = pad_obstacles([obstacles(apartment(), 0.02, 0.38)])[0]
    together = pad_obstacles([obstacles(cluttered(seed), 0.02, 0.38) for seed in range(5)])[0]
    assert alone.boxes.shape == together.boxes.shape
    assert alone.cylinders.shape == together.cylinders.shape


NOTHING = LidarOutlines(
    *(jnp.zeros((8, columns)) for columns in (4, 6, 3)),
    *(jnp.zeros((0, columns)) for columns in (14, 20, 26)),
    counts=jnp.zeros(6, jnp.int32),
)


def test_an_array_of_the_wrong_shape_is_refused_in_tests():
    with pytest.raises(jaxtyping.TypeCheckError):
        scan_ranges(NOTHING, jnp.zeros(4), np.zeros(8, np.float32), 1.0)
