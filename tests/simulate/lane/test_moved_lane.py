"""A lane that starts beside its place: by what is asked, or by the least that single precision knows."""

from typing import Any, cast

import numpy as np
import pytest

from tasks.simulate.application.contract import Placement
from tasks.simulate.lane.staging import Lane, moved_lane
from tests.factories.simulations import delivery


def lane(x_m: float) -> Lane:
    placement = Placement(np.array([x_m, 2.0, 0.5]), np.array([[1.0, 1.0]]))
    return Lane(delivery(0, world="hand/apartment-0"), cast("Any", None), placement, None)


@pytest.mark.parametrize("x_m", [0.0, 3.7, 900.0, -900.0])
@pytest.mark.parametrize("beside_m", [1e-6, -1e-6])
def test_a_robot_starts_beside_its_place_even_far_from_the_origin(x_m: float, beside_m: float):
    moved = moved_lane(lane(x_m), (beside_m, 0.0)).placement
    apart_m = float(np.float32(moved.start[0])) - float(np.float32(x_m))
    assert np.sign(apart_m) == np.sign(beside_m)
    assert abs(apart_m) < 1e-4
    assert tuple(moved.start[1:]) == (2.0, 0.5)


def test_a_lane_that_is_not_moved_is_the_same():
    assert np.array_equal(moved_lane(lane(3.7), (0.0, 0.0)).placement.start, lane(3.7).placement.start)
