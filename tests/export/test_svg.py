"""The floor plan is valid, complete, to scale and the right way up."""

from xml.etree import ElementTree as ET

import pytest
from hypothesis import given

from specs.world import World
from tasks.export.svg import floor_plan_svg
from tests.worlds_factory import apartment, apartments

SVG = "{http://www.w3.org/2000/svg}"


def drawn(world: World) -> ET.Element:
    return ET.fromstring(floor_plan_svg(world))  # noqa: S314 - our own document


def group(root: ET.Element, name: str) -> ET.Element:
    return next(found for found in root.iter(f"{SVG}g") if found.get("class") == name)


def number(found: ET.Element, attribute: str) -> float:
    return float(found.get(attribute, "nan"))


def texts(root: ET.Element) -> str:
    return "\n".join(found.text or "" for found in root.iter() if found.tag != f"{SVG}style")


@given(apartments())
def test_the_plan_is_well_formed_whatever_the_names(world: World):
    assert drawn(world).tag == f"{SVG}svg"


def test_a_name_with_markup_is_shown_and_not_obeyed():
    root = drawn(apartment(room_names=("</svg><script>alert(1)</script>", "A & B")))
    assert not list(root.iter(f"{SVG}script"))
    assert "A & B" in texts(root)


def test_every_room_is_named_with_its_area():
    shown = texts(drawn(apartment()))
    for wanted in ("Living room", "20.0 m²", "Kitchen", "16.0 m²"):
        assert wanted in shown.split("\n")


def test_every_piece_of_furniture_has_its_name_as_tooltip():
    titles = [found.findtext(f"{SVG}title") for found in group(drawn(apartment()), "pieces")]
    assert sorted(title.split(":")[0] for title in titles if title) == ["lamp-1", "sofa-1", "table-1"]


def test_the_start_circle_has_one_metre_radius_at_the_scale_of_the_plan():
    root = drawn(apartment())
    footprint = next(found for found in root.iter(f"{SVG}rect") if found.get("class") == "threshold")
    circle = next(found for found in root.iter(f"{SVG}circle") if found.get("class") == "clear")
    assert number(circle, "r") == pytest.approx(number(footprint, "width") / 9.3, abs=0.01)


def test_y_is_up():
    root = drawn(apartment())
    lamp_circle = next(group(root, "pieces").iter(f"{SVG}circle"))  # the lamp stands at y = 1.6 m, west of the start
    start = next(found for found in root.iter(f"{SVG}circle") if found.get("class") == "clear")
    assert number(lamp_circle, "cy") < number(start, "cy")
    assert number(lamp_circle, "cx") < number(start, "cx")


def test_a_turn_against_the_clock_is_drawn_against_the_clock():
    turns = [found.get("transform") for found in group(drawn(apartment()), "pieces").iter(f"{SVG}rect")]
    assert any(turn and turn.startswith("rotate(-22.918") for turn in turns)


def test_a_lintel_does_not_close_its_doorway():
    classes = [found.get("class") for found in group(drawn(apartment()), "walls")]
    assert classes.count("lintel") == 1
    assert classes.count("wall") == 6


def test_the_certificate_is_told():
    shown = texts(drawn(apartment())).split("\n")
    for wanted in ("1.05 m", "0.41 m", "0.90 m", "86 %", "1.2 %"):
        assert wanted in shown


def test_unmet_wishes_are_told_and_many_are_counted():
    shown = texts(drawn(apartment(unmet=tuple(f"wish {number}" for number in range(9)))))
    assert "Not fulfilled: wish 0" in shown
    assert "and 3 more wishes not fulfilled" in shown


@given(apartments())
def test_everything_lies_on_the_page(world: World):
    root = drawn(world)
    _, _, width, height = (float(part) for part in root.get("viewBox", "").split())
    for found in root.iter(f"{SVG}text"):
        assert 0 <= number(found, "x") <= width
        assert 0 <= number(found, "y") <= height


def test_the_same_world_gives_the_same_text():
    assert floor_plan_svg(apartment()) == floor_plan_svg(apartment())
