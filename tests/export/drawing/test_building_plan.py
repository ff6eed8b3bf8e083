"""A label finds the free part of its room."""

from hypothesis import given
from hypothesis import strategies as st

from tasks.export.drawing.building_plan import NAME_SIZE, place_label
from tasks.export.drawing.plan_page import PageBox
from tests.factories.worlds import names

ROOM = PageBox(0, 0, 400, 300)


def test_an_empty_room_is_labelled_in_its_middle():
    label = place_label("Kitchen", ["12 m²"], ROOM, [])
    assert (label.x, label.y) == ROOM.center
    assert label.size == NAME_SIZE


def test_a_label_moves_off_the_furniture():
    label = place_label("Kitchen", ["12 m²"], ROOM, [PageBox(0, 0, 400, 200)])
    assert label.y > 200


def test_a_name_that_is_too_long_for_a_narrow_room_stands_upright():
    label = place_label("A long hallway", ["9 m²"], PageBox(0, 0, 60, 500), [])
    assert label.upright
    assert label.name == "A long hallway"


def test_a_name_that_fits_nowhere_is_cut():
    label = place_label("x" * 255, ["9 m²"], ROOM, [])
    assert label.name.endswith("…")


@given(names, st.floats(20, 900), st.floats(20, 900))
def test_a_label_stays_in_its_room(name: str, width: float, height: float):
    label = place_label(
        name, ["9 m², of which much is free", "9 m²"], PageBox(0, 0, width, height), [PageBox(0, 0, width / 2, height)]
    )
    assert 0 <= label.x <= width
    assert 0 <= label.y <= height
    if min(width, height) > 60:
        assert 0 <= label.box.left <= label.box.right <= width
        assert 0 <= label.box.top <= label.box.bottom <= height


def test_a_second_line_that_does_not_fit_is_a_shorter_one_or_none():
    details = ["12.0 m² · 83 % free", "12.0 m²"]
    assert place_label("A", details, ROOM, []).detail == details[0]
    assert place_label("A", details, PageBox(0, 0, 80, 80), []).detail == details[1]
    assert place_label("A", details, PageBox(0, 0, 30, 30), []).detail == ""
