"""The grid that range_libc casts rays on holds what stands in the world."""

import numpy as np
import pytest

from benchmarks.rivals.range_libc import occupied
from tasks.simulate.geometry.obstacles import Obstacles

TURNED = (1.0, 0.0, 0.5, 0.3, 0.1, 0.5, 0.0, 1.0)  # x, y, z, half extents, cosine and sine of a quarter turn
POST = (-1.0, -1.0, 0.5, 0.2, 0.5)


def test_a_cell_is_taken_where_its_middle_lies_in_a_solid():
    solids = Obstacles(np.array([TURNED], np.float32), np.array([POST], np.float32))
    cells = occupied(solids, 0.1, 2.0)
    x, y = (np.argwhere(cells).T + 0.5) * 0.1 - 2.0
    box, post = x > 0, x < 0
    assert [np.abs(x[box] - 1.0).max(), np.abs(y[box]).max()] == pytest.approx([0.05, 0.25])
    assert np.hypot(x[post] + 1.0, y[post] + 1.0).max() <= 0.2
    assert np.count_nonzero(post) == 12
