"""Worlds become arrays of the solids at the robot's height, of few different sizes."""

import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest

from tasks.simulate.geometry.lidar_scan import LidarOutlines, scan_ranges
from tasks.simulate.geometry.obstacles import PARKING_M, obstacles, pad_obstacles
from tests.factories.simulations import cluttered
from tests.factories.worlds import apartment


def test_only_solids_in_the_band_of_heights_are_kept():
    low = obstacles(apartment(), 0.02, 0.38)
    high = obstacles(apartment(), 2.2, 2.3)
    # 6 walls, the sofa's seat and the table are low; the lintel, and the walls, are high.
    assert len(low.boxes) == 8
    assert len(low.cylinders) == 2
    assert len(high.boxes) == 7
    assert len(high.cylinders) == 0


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


NOTHING = LidarOutlines(jnp.zeros((8, 4)), jnp.zeros((8, 6)), jnp.zeros((8, 3)), jnp.zeros(3, jnp.int32))


def test_an_array_of_the_wrong_shape_is_refused_in_tests():
    with pytest.raises(jaxtyping.TypeCheckError):
        scan_ranges(NOTHING, jnp.zeros(4), np.zeros(8, np.float32), 1.0)
