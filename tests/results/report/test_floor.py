"""Worlds from above: where things stand, in centimetres, and y up."""

import numpy as np

from specs.data.world import Solid
from tasks.results.report.floor import dots_path, draw_floor, way_path
from tests.factories.worlds import apartment


def test_the_drawing_is_as_large_as_the_world_and_a_margin():
    drawing = draw_floor(apartment())
    assert drawing.view_box == "-268 -218 946 436"


def test_rooms_stand_where_they_are_and_up_is_up():
    living, kitchen = draw_floor(apartment()).rooms
    assert (living.label, kitchen.label) == ("Living room", "Kitchen")
    assert living.x + living.width <= kitchen.x
    assert living.y < 0 < living.y + living.height


def test_a_name_that_does_not_fit_its_room_is_cut():
    drawing = draw_floor(apartment(room_names=("x" * 500, "Kitchen")))
    label = drawing.rooms[0].label
    assert label.endswith("…")
    assert len(label) * 0.56 * drawing.letter <= drawing.rooms[0].width + drawing.letter


def test_what_hangs_above_the_robot_is_not_drawn():
    lamp = Solid(
        name="lintel", shape="box", center_m=(0, 0, 2.3), half_extents_m=(0.1, 0.1, 0.2), yaw_rad=0, color=(1, 1, 1)
    )
    low = lamp.model_copy(update={"center_m": (0, 0, 1.0)})
    assert draw_floor(apartment().model_copy(update={"walls": (lamp,)})).walls == ""
    assert draw_floor(apartment().model_copy(update={"walls": (low,)})).walls == "M-10 10L10 10 10 -10 -10 -10z"


def test_a_way_is_where_the_robot_went_with_each_step_from_the_one_before():
    way_m = np.array([[0.0, 0.0], [1.0, 0.5], [1.0, 0.5], [0.5, -0.25]])
    assert way_path(way_m) == "M0 0l100-50-50 75"


def test_a_way_that_goes_nowhere_is_a_dot_and_none_is_nothing():
    assert way_path(np.array([[0.1, 0.2], [0.1, 0.2]])) == "M10 -20h0"
    assert way_path(np.zeros((0, 2))) == ""
    assert dots_path(np.array([[0.1, 0.2], [1.0, 1.0]])) == "M10 -20h0M100 -100h0"
