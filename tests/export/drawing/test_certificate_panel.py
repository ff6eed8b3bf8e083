"""The panel tells what is guaranteed and every wish, the unmet ones first."""

from xml.etree import ElementTree as ET

import pytest

from specs.data.world import Certificate, Wish, World
from tasks.export.drawing.floor_plan import MAX_WISHES, certificate_height, draw_certificate, wishes_met
from tasks.export.drawing.plan_page import PageBox, text_width
from tests.export.variants import with_door
from tests.factories.worlds import apartment

MET = Wish(kind="area", subject="Kitchen", wished="16 m2", found="16.1 m2", met=True, error=0.006)
UNMET = Wish(kind="aspect", subject="Kitchen", wished="2:1", found="4.00 x 4.00 m, 1:1", met=False, error=0.5)


def wishing(*wishes: Wish) -> World:
    world = apartment()
    return world.model_copy(update={"certificate": world.certificate.model_copy(update={"wishes": wishes})})


def drawn(world: World) -> ET.Element:
    root = ET.Element("svg")
    draw_certificate(root, world, PageBox(60, 0, 920, 0))
    return root


def texts(world: World) -> list[str]:
    return [found.text or "" for found in drawn(world).iter("text")]


def test_the_guarantees_are_told_in_figures():
    assert {"1.05 m", "0.41 m", "0.90 m", "86 %", "1.2 %"} <= set(texts(apartment()))


def test_what_doors_leave_is_told_where_there_are_doors():
    assert "doors as they stand" in texts(with_door(30.0))
    assert "doors as they stand" not in texts(apartment())


def test_a_wish_is_told_with_both_figures():
    shown = texts(wishing(MET, UNMET))
    assert "Kitchen, aspect" in shown
    assert "4.00 x 4.00 m, 1:1 (wished 2:1)" in shown
    assert "16.1 m² (wished 16 m²)" in shown


def test_what_is_as_wished_is_said_once():
    same = MET.model_copy(update={"kind": "walls", "wished": "Brick", "found": "Brick"})
    assert "Brick" in texts(wishing(same))


def test_unmet_wishes_come_first_and_are_marked():
    classes = [found.get("class") for found in drawn(wishing(MET, UNMET, MET)).iter("g")]
    assert [name for name in classes if name and name.startswith("wish")] == ["wish unmet", "wish met", "wish met"]


@pytest.mark.parametrize(
    ("wishes", "told"),
    [
        ((), "no wishes"),
        ((MET, MET), "all 2 wishes fulfilled"),
        ((MET, UNMET), "1 of 2 wishes fulfilled"),
    ],
)
def test_the_count_of_wishes_is_a_sentence(wishes: tuple[Wish, ...], told: str):
    assert wishes_met(wishing(*wishes).certificate) == told


def test_more_wishes_than_there_is_room_for_are_counted():
    many = wishing(*([MET] * 40 + [UNMET] * 5))
    shown = texts(many)
    assert f"and {45 - MAX_WISHES + 1} more, fulfilled" in shown
    assert sum("wished 2:1" in text for text in shown) == 5
    assert "and 13 more, 13 of them not fulfilled" in texts(wishing(*([UNMET] * 40)))


def test_a_long_name_is_cut_and_what_was_wished_of_it_is_not():
    long = MET.model_copy(update={"subject": "x" * 200})
    (shown,) = [text for text in texts(wishing(long)) if text.startswith("xx")]
    assert shown.endswith("…, area")
    assert text_width(shown, 11.0) < 200


@pytest.mark.parametrize("count", [0, 1, 2, 27, 28, 60])
def test_the_panel_has_the_height_that_it_says(count: int):
    world = wishing(*([MET] * count))
    lowest = max(float(found.get("y", "nan")) for found in drawn(world).iter("text"))
    assert lowest <= certificate_height(world.certificate) < lowest + 30


def test_a_hostile_name_is_escaped():
    evil = MET.model_copy(update={"subject": "</svg><script>"})
    assert b"<script>" not in ET.tostring(drawn(wishing(evil)))


def test_a_certificate_without_wishes_has_no_heading():
    certificate: Certificate = apartment().certificate
    assert certificate.wishes == ()
    assert not any("wish" in text for text in texts(apartment()))
