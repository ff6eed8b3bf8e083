"""Layouts know their rooms' cells and which of them lie side by side."""

import numpy as np
import pytest

from tasks.worlds.floorplan.scoring import Layouts, common_walls, join_layouts


def row(*borders: float) -> Layouts:
    """Returns rooms side by side between these x, 4 m deep."""
    rooms = len(borders) - 1
    inner = list(range(4, 3 + rooms))
    edges = [0, *inner, 2]
    sides = np.array([[edges[n], 1, edges[n + 1], 3] for n in range(rooms)])[:, :, None]
    lines = np.array([borders[0], 0.0, borders[-1], 4.0, *borders[1:-1]])[:, None]
    return Layouts(sides, np.array([True, False, True, False, *[True] * len(inner)])[:, None], lines)


def test_cells_lie_between_their_lines() -> None:
    assert row(0.0, 3.0, 8.0).cells()[:, :, 0].T.tolist() == [[0.0, 0.0, 3.0, 4.0], [3.0, 0.0, 8.0, 4.0]]


def test_some_of_several_layouts_can_be_taken() -> None:
    both = join_layouts([row(0.0, 3.0, 8.0), row(0.0, 5.0, 8.0)])
    assert both[np.array([1])].cells().tolist() == row(0.0, 5.0, 8.0).cells().tolist()


def test_moving_a_line_moves_the_rooms_at_both_sides() -> None:
    layout = row(0.0, 3.0, 8.0)
    lines = layout.lines.copy()
    lines[4] = 3.5
    assert layout.moved(lines).cells()[[2, 0], [0, 1], 0].tolist() == [3.5, 3.5]


@pytest.mark.parametrize(
    ("other", "length"),
    [
        ((4.0, 1.0, 7.0, 6.0), 3.0),
        ((1.0, 4.0, 9.0, 6.0), 3.0),
        ((4.0, 4.0, 7.0, 7.0), 0.0),
        ((4.5, 0.0, 7.0, 4.0), 0.0),
    ],
)
def test_cells_that_touch_have_a_wall_in_common(other: tuple[float, ...], length: float) -> None:
    cells = np.array([(0.0, 0.0, 4.0, 4.0), other]).T[:, :, None]
    assert common_walls(cells, np.array([0]), np.array([1])).item() == pytest.approx(length)
    assert common_walls(cells, np.array([1]), np.array([0])).item() == pytest.approx(length)
