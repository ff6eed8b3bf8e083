"""Cells of a floor map, for tests that look into one."""

import numpy as np
from jaxtyping import Float64

from tasks.simulate.application.contract import HostMap


def cell_of(floor: HostMap, point_m: Float64[np.ndarray, "2"]) -> tuple[int, int]:
    """Returns the (row, column) of the cell that holds a point, clipped to the grid."""
    column, row = np.rint((point_m - floor.origin_m) / floor.cell_m).astype(int)
    rows, columns = floor.clearance_m.shape
    return int(np.clip(row, 0, rows - 1)), int(np.clip(column, 0, columns - 1))
