"""Numbers and text as the page needs them."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.world import Solid
from tasks.export.drawing.plan_page import (
    PageScale,
    corners_m,
    covers,
    css_color,
    fit_text,
    from_above,
    page_box,
    printable,
    text_width,
    written_as,
)
from tests.factories.worlds import box


@pytest.mark.parametrize(
    ("value", "written"), [(1.0, "1"), (0.5, "0.5"), (-0.001, "0"), (12.346, "12.35"), (100.0, "100")]
)
def test_numbers_are_short(value: float, written: str):
    assert written_as(value) == written


def test_characters_that_xml_forbids_are_replaced():
    assert printable("a\x00b\x1fc\ufffe") == "a\ufffdb\ufffdc\ufffd"


@given(st.text(), st.floats(1, 500))
def test_fitted_text_fits(text: str, width: float):
    shown = fit_text(text, 10.0, width)
    assert shown == "…" or text_width(shown, 10.0) <= width


def test_colours_mix_with_white():
    assert css_color((0.0, 0.5, 1.0)) == "#0080ff"
    assert css_color((0.0, 0.0, 0.0), 1.0) == "#ffffff"


TOP = box("top", (0.0, 0.0, 0.7), (1.4, 0.8, 0.74), (0.5, 0.5, 0.5))
LEG = box("leg", (0.05, 0.05, 0.0), (0.1, 0.1, 0.7), (0.5, 0.5, 0.5))


def test_a_leg_below_a_table_is_not_seen():
    assert from_above([TOP, LEG]) == [TOP]


def test_a_leg_that_stands_out_is_seen_and_drawn_first():
    out = LEG.model_copy(update={"center_m": (0.0, 0.0, 0.35)})
    assert from_above([TOP, out]) == [out, TOP]


def test_a_round_foot_is_hidden_by_a_round_shade_that_is_wide_enough():
    shade = LEG.model_copy(update={"shape": "cylinder", "half_extents_m": (0.2, 0.2, 0.1), "center_m": (0, 0, 1.5)})
    foot = shade.model_copy(update={"half_extents_m": (0.1, 0.1, 0.02), "center_m": (0, 0, 0.02)})
    assert from_above([foot, shade]) == [shade]


@given(st.floats(-math.pi, math.pi), st.floats(-0.69, 0.69), st.floats(-0.39, 0.39))
def test_a_turned_solid_covers_what_turns_with_it(yaw_rad: float, along_m: float, aside_m: float):
    turned: Solid = TOP.model_copy(update={"yaw_rad": yaw_rad})
    x_m = turned.center_m[0] + along_m * math.cos(yaw_rad) - aside_m * math.sin(yaw_rad)
    y_m = turned.center_m[1] + along_m * math.sin(yaw_rad) + aside_m * math.cos(yaw_rad)
    assert covers(turned, x_m, y_m)
    beyond_m = [2 * corner - middle for corner, middle in zip(corners_m(turned)[0], turned.center_m, strict=False)]
    assert not covers(turned, beyond_m[0], beyond_m[1])


def test_the_box_of_a_quarter_turn_is_turned():
    sheet = PageScale(x_min_m=0.0, y_max_m=0.0, units_per_m=100.0, left=0.0, top=0.0)
    turned = TOP.model_copy(update={"yaw_rad": math.pi / 2})
    around = page_box([turned], (0.0, 0.0), sheet)
    assert (around.width, around.height) == pytest.approx((80.0, 140.0))
    assert page_box([], (0.1, -0.2), sheet).center == pytest.approx((10.0, 20.0))
