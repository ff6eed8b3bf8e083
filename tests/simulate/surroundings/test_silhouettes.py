"""What the lidar can see of a world."""

import numpy as np
import pytest

from tasks.simulate.geometry.lidar_scan import lidar_outlines, pad_lidar_outlines
from tasks.simulate.geometry.obstacles import PARKING_M, Obstacles


def box(x: float, half_x: float, half_y: float, yaw_rad: float) -> tuple[float, ...]:
    return (x, 0.0, 0.5, half_x, half_y, 0.5, np.cos(yaw_rad), np.sin(yaw_rad))


def seen(*boxes: tuple[float, ...]) -> Obstacles:
    return Obstacles(np.array(boxes, np.float32), np.array([(7.0, 8.0, 0.5, 0.3, 0.5)], np.float32))


@pytest.mark.parametrize(
    ("yaw_rad", "half"),
    [(0.0, (0.4, 0.1)), (np.pi, (0.4, 0.1)), (np.pi / 2, (0.1, 0.4)), (-np.pi / 2, (0.1, 0.4))],
)
def test_a_quarter_turn_leaves_a_box_upright(yaw_rad: float, half: tuple[float, float]):
    found = lidar_outlines(seen(box(1.0, 0.4, 0.1, yaw_rad)))
    np.testing.assert_allclose(found.upright, [(1.0, 0.0, *half)], atol=1e-6)
    assert found.counts.tolist() == [1, 0, 1]


def test_a_little_turn_does_not():
    found = lidar_outlines(seen(box(1.0, 0.4, 0.1, 1e-4), box(2.0, 0.4, 0.1, np.pi / 2 + 1e-4)))
    assert found.counts.tolist() == [0, 2, 1]
    np.testing.assert_allclose(found.turned[0], (1.0, 0.0, 0.4, 0.1, 1.0, 1e-4), atol=1e-6)


def test_circles_keep_place_and_radius():
    np.testing.assert_allclose(lidar_outlines(seen(box(1.0, 0.4, 0.1, 0.0))).circles, [(7.0, 8.0, 0.3)])


def test_worlds_are_padded_to_the_same_sizes_with_what_nobody_sees():
    one, two = lidar_outlines(seen(box(1.0, 0.4, 0.1, 0.0))), lidar_outlines(seen(*[box(1.0, 0.4, 0.1, 0.3)] * 65))
    first, second = pad_lidar_outlines([one, two])
    assert [len(each) for each in first[:3]] == [len(each) for each in second[:3]] == [256, 128, 64]
    np.testing.assert_array_equal(first.upright[:1], one.upright)
    assert (first.upright[1:, :2] == PARKING_M).all()
    assert (first.turned[:, 4] == 1.0).all()
