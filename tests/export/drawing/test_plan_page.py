"""Numbers and text as the page needs them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.export.drawing.plan_page import css_color, fit_text, printable, text_width, written_as


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
