"""Boxes on the floor."""

import numpy as np

from tasks.worlds.geometry.boxes import Box, bounding_box, find_meetings, inset, rounded

UNIT = Box(0.0, 0.0, 1.0, 1.0)


def test_boxes_that_share_a_border_do_not_meet() -> None:
    assert not UNIT.meets(UNIT.shifted(1.0, 0.0))
    assert UNIT.meets(UNIT.shifted(0.99, 0.99))


def test_many_boxes_meet_others_as_one_does() -> None:
    boxes = [UNIT.shifted(0.3 * n, 0.1 * n) for n in range(8)]
    others = [UNIT, UNIT.shifted(3.0, 0.0)]
    expected = [[box.meets(other) for other in others] for box in boxes]
    assert find_meetings(np.array(boxes).T, inset(np.array(others).T)).tolist() == expected


def test_the_box_around_boxes_holds_them_all() -> None:
    assert bounding_box([UNIT, UNIT.shifted(3.0, -2.0), UNIT.shifted(1.0, 1.0)]) == Box(0.0, -2.0, 4.0, 2.0)


def test_a_grown_box_keeps_its_middle() -> None:
    assert UNIT.grown(-0.2).center == UNIT.center
    assert UNIT.grown(0.5).area == 4.0


def test_a_document_holds_no_negative_zero() -> None:
    assert str(rounded(-1e-9)) == "0.0"
