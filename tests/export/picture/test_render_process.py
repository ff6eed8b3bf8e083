"""The picture holds the whole apartment, however it is shaped."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.world import Rectangle
from tasks.export.picture.render_process import whole_view
from tests.factories.worlds import apartment

HALF_HEIGHT = math.tan(math.radians(14.0))
sides_m = st.floats(3.0, 40.0)


@given(sides_m, sides_m, st.sampled_from([4 / 3, 1.0, 16 / 9]))
def test_the_apartment_fills_the_picture_and_stays_in_it(width_m: float, depth_m: float, aspect: float):
    footprint = Rectangle(x_min_m=-1.5, y_min_m=-1.5, x_max_m=width_m - 1.5, y_max_m=depth_m - 1.5)
    view = whole_view(apartment().model_copy(update={"footprint": footprint}), aspect)
    corners = np.array([(x, y, 0.0) for x in (-1.5, width_m - 1.5) for y in (-1.5, depth_m - 1.5)])
    seen = (corners - view.target_m) @ view.axes.T
    places = np.abs(seen[:, :2] / (seen[:, 2:] + view.distance_m) / (HALF_HEIGHT * aspect, HALF_HEIGHT))
    assert places.max() < 1.0
    assert places.max() > 0.75


@pytest.mark.parametrize(("depth_m", "turned"), [(5.0, False), (30.0, True)])
def test_a_long_apartment_lies_across_the_picture(depth_m: float, *, turned: bool):
    footprint = Rectangle(x_min_m=-3.0, y_min_m=-3.0, x_max_m=3.0, y_max_m=depth_m - 3.0)
    across = whole_view(apartment().model_copy(update={"footprint": footprint}), 4 / 3).axes[0]
    assert (abs(across[1]) > abs(across[0])) == turned
