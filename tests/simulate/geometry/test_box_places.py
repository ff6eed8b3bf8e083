"""Places of boxes: on the robot's way, clear of where it starts and arrives, and the same whatever is beside them."""

import numpy as np
import pytest

from specs.data.boxes import MOST_BOXES, Box
from tasks.simulate.application.contract import Placement
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.geometry.box_places import NEVER_STEP, BoxesRefused, HostBoxes, host_boxes
from tasks.simulate.geometry.obstacles import Obstacles
from tasks.simulate.geometry.shortest_path import Ways

HULL = Hull(radius_m=0.2, low_m=0.1, high_m=0.4, mass_kg=2.0)
EMPTY = Obstacles(
    np.array([[50.0, 50.0, 0.5, 0.1, 0.1, 0.5, 1.0, 0.0]], np.float32),
    np.zeros((0, 5), np.float32),
    np.zeros((0, 20), np.float32),
)
START, GOALS = np.array([0.0, 0.0, 0.0]), np.array([[4.0, 0.0], [4.0, 3.0]])
SMALL = Box(size_m=(0.4, 0.3, 0.6))


def found(*boxes: Box, seed: int = 3, goals: np.ndarray = GOALS) -> HostBoxes:
    return host_boxes(boxes, seed, Placement(START, goals), Ways(EMPTY, HULL.radius_m), HULL)


def test_a_drawn_box_is_on_the_way_and_leaves_room_at_its_ends():
    for seed in range(50):
        x, y = found(SMALL, seed=seed).place_m[0]
        assert (abs(y) < 1e-6 and 0.0 < x < 4.0) or (abs(x - 4.0) < 1e-6 and 0.0 < y < 3.0)
        stops = np.concatenate([START[None, :2], GOALS])
        assert np.hypot(*(stops - [x, y]).T).min() > 0.2 + 0.25 + 0.09


def test_seeds_draw_other_places_and_a_box_the_same_whatever_is_beside_it():
    assert len({tuple(found(SMALL, seed=seed).place_m[0]) for seed in range(20)}) == 20
    alone, together = found(SMALL), found(SMALL, SMALL, Box(size_m=(1.0, 1.0, 1.0), at_m=(1.0, 2.0)))
    np.testing.assert_array_equal(alone.place_m[0], together.place_m[0])
    assert not np.array_equal(together.place_m[0], together.place_m[1])
    assert together.place_m[2].tolist() == [1.0, 2.0]


def test_times_become_control_steps_and_places_that_are_left_over_never_appear():
    boxes = found(Box(size_m=(0.4, 0.3, 0.6), at_m=(1.0, 1.0), appears_s=5.0, leaves_s=20.0), SMALL)
    assert boxes.appears.tolist() == [100, 0, *[NEVER_STEP] * (MOST_BOXES - 2)]
    assert boxes.leaves.tolist() == [400, *[NEVER_STEP] * (MOST_BOXES - 1)]
    np.testing.assert_allclose(boxes.half_m[0], [0.2, 0.15, 0.3])


def test_a_hull_passes_over_a_box_that_is_lower():
    boxes = found(Box(size_m=(0.4, 0.3, 0.05), at_m=(1.0, 1.0)), Box(size_m=(0.4, 0.3, 0.2), at_m=(2.0, 1.0)))
    assert boxes.touched.tolist()[:2] == [False, True]


def test_a_way_that_is_too_short_for_a_box_is_refused():
    with pytest.raises(BoxesRefused, match=r"boxes: \[1\]: no place on the robot's way"):
        found(Box(size_m=(0.4, 0.3, 0.6), at_m=(1.0, 1.0)), SMALL, goals=np.array([[0.5, 0.0]]))
