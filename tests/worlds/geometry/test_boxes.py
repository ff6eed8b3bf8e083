"""Boxes on the floor."""

from tasks.worlds.geometry import Box, bounding_box, rounded

UNIT = Box(0.0, 0.0, 1.0, 1.0)


def test_boxes_that_share_a_border_do_not_meet() -> None:
    assert not UNIT.meets(UNIT.shifted(1.0, 0.0))
    assert UNIT.meets(UNIT.shifted(0.99, 0.99))


def test_the_box_around_boxes_holds_them_all() -> None:
    assert bounding_box([UNIT, UNIT.shifted(3.0, -2.0), UNIT.shifted(1.0, 1.0)]) == Box(0.0, -2.0, 4.0, 2.0)


def test_a_grown_box_keeps_its_middle() -> None:
    assert UNIT.grown(-0.2).center == UNIT.center
    assert UNIT.grown(0.5).area == 4.0


def test_a_document_holds_no_negative_zero() -> None:
    assert str(rounded(-1e-9)) == "0.0"
