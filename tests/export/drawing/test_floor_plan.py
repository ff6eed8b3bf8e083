"""The floor plan is valid, complete, to scale and the right way up."""

import math
import re
from collections.abc import Iterator
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.world import Certificate, Wish, World
from tasks.export.drawing.floor_plan import MAX_WISHES, certificate_height, draw_certificate, floor_plan_svg, wishes_met
from tasks.export.drawing.plan_page import PageBox, text_width
from tests.export.variants import HINGE_M, LEAF_LENGTH_M, LEAF_THICKNESS_M, with_door, with_windows
from tests.factories.worlds import apartment, apartments

SVG = "{http://www.w3.org/2000/svg}"
ARC = r"M([\d.]+) ([\d.]+)A[\d.]+ [\d.]+ 0 0 ([01]) ([\d.]+) ([\d.]+)L"


def drawn(world: World) -> ET.Element:
    return ET.fromstring(floor_plan_svg(world))  # noqa: S314 - our own document


def group(root: ET.Element, name: str) -> ET.Element:
    return next(found for found in root.iter(f"{SVG}g") if found.get("class") == name)


def number(found: ET.Element, attribute: str) -> float:
    return float(found.get(attribute, "nan"))


def texts(root: ET.Element) -> str:
    return "\n".join(found.text or "" for found in root.iter() if found.tag != f"{SVG}style")


def placed(parent: ET.Element) -> Iterator[PageBox]:
    """Yields about what each text of a group covers: its letters, without the space above and below them."""
    for holder in parent.iter():
        for text in holder.findall(f"{SVG}text"):
            size, x, y = number(text, "font-size"), number(text, "x"), number(text, "y")
            half = 0.45 * text_width(text.text or "", size)
            x -= half if text.get("text-anchor") == "end" else 0.0
            box = PageBox(x - half, y - 0.7 * size, x + half, y)
            turn = re.match(r"rotate\(-90 (\S+) (\S+)\)", text.get("transform") or holder.get("transform") or "")
            yield upright(box, float(turn[1]), float(turn[2])) if turn else box


def upright(box: PageBox, x: float, y: float) -> PageBox:
    """Returns a box turned by a quarter about a point, against the clock."""
    return PageBox(x + box.top - y, y - (box.right - x), x + box.bottom - y, y - (box.left - x))


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


@given(apartments(), st.sampled_from([0.0, 30.0, 100.0]))
def test_no_text_covers_another_in_the_rooms(world: World, percent: float):
    root = drawn(with_door(percent, with_windows(world)))
    boxes = [box for name in ("start", "labels", "piece-labels") for box in placed(group(root, name))]
    for number, box in enumerate(boxes):
        assert not any(box.overlap(other) > 1.0 for other in boxes[:number])


@pytest.mark.parametrize(("percent", "tip"), [(0.0, (0.0, -1.0)), (100.0, (1.0, 0.0))])
def test_a_door_is_drawn_from_its_hinge_to_where_its_leaf_points(percent: float, tip: tuple[float, float]):
    root = drawn(with_door(percent))
    scale, origin = (
        float(root.get("data-units-per-m", "")),
        [float(root.get(f"data-origin-{axis}", "")) for axis in "xy"],
    )
    leaf = next(found for found in group(root, "doors").iter(f"{SVG}rect") if found.get("class") == "leaf")
    middle = number(leaf, "x") + number(leaf, "width") / 2, number(leaf, "y") + number(leaf, "height") / 2
    hinge = origin[0] + HINGE_M[0] * scale, origin[1] - HINGE_M[1] * scale
    wanted = [at + LEAF_LENGTH_M / 2 * scale * step for at, step in zip(hinge, tip, strict=True)]
    assert middle == pytest.approx(wanted, abs=LEAF_THICKNESS_M * scale)


@pytest.mark.parametrize(("open_yaw_rad", "across", "clockwise"), [(0.0, 1.0, "1"), (math.pi, -1.0, "0")])
def test_a_door_shows_the_arc_of_its_swing(open_yaw_rad: float, across: float, clockwise: str):
    world = with_door(30.0)
    door = world.doors[0].model_copy(update={"open_yaw_rad": open_yaw_rad})
    root = drawn(world.model_copy(update={"doors": (door,)}))
    swing = next(group(root, "doors").iter(f"{SVG}path"))
    arc = re.match(ARC, swing.get("d", ""))
    assert arc is not None
    length = LEAF_LENGTH_M * float(root.get("data-units-per-m", ""))
    # Shut it points north, open east or west: the quarter of a circle between.
    moved = float(arc[4]) - float(arc[1]), float(arc[5]) - float(arc[2])
    assert moved == pytest.approx((across * length, length), abs=0.1)
    assert arc[3] == clockwise


def test_every_window_is_drawn_in_its_wall():
    root = drawn(with_windows())
    panes = list(group(root, "windows").iter(f"{SVG}rect"))
    scale = float(root.get("data-units-per-m", ""))
    sizes = sorted((number(pane, "width") / scale, number(pane, "height") / scale) for pane in panes)
    assert sizes == [pytest.approx((0.1, 1.2), abs=1e-3), pytest.approx((1.6, 0.1), abs=1e-3)]


def test_a_flooring_is_divided_to_scale():
    root = drawn(apartment())
    scale = float(root.get("data-units-per-m", ""))
    sizes = {
        (round(number(each, "width") / scale, 2), round(number(each, "height") / scale, 2))
        for each in root.iter(f"{SVG}pattern")
    }
    assert sizes == {(0.4, 0.8), (0.4, 0.2)}  # four rows of planks, one tile


def test_the_floorings_are_named_beside_the_scale():
    assert {"Floorboards", "Tiles"} <= set(texts(drawn(apartment())).split("\n"))


@given(apartments())
def test_everything_lies_on_the_page(world: World):
    root = drawn(world)
    _, _, width, height = (float(part) for part in root.get("viewBox", "").split())
    for found in root.iter(f"{SVG}text"):
        assert 0 <= number(found, "x") <= width
        assert 0 <= number(found, "y") <= height


def test_the_same_world_gives_the_same_text():
    assert floor_plan_svg(apartment()) == floor_plan_svg(apartment())


MET = Wish(kind="area", subject="Kitchen", wished="16 m2", found="16.1 m2", met=True, error=0.006)
UNMET = Wish(kind="aspect", subject="Kitchen", wished="2:1", found="4.00 x 4.00 m, 1:1", met=False, error=0.5)


def wishing(*wishes: Wish) -> World:
    world = apartment()
    return world.model_copy(update={"certificate": world.certificate.model_copy(update={"wishes": wishes})})


def drawn_certificate(world: World) -> ET.Element:
    root = ET.Element("svg")
    draw_certificate(root, world, PageBox(60, 0, 920, 0))
    return root


def certificate_texts(world: World) -> list[str]:
    return [found.text or "" for found in drawn_certificate(world).iter("text")]


def test_the_guarantees_are_told_in_figures():
    assert {"1.05 m", "0.41 m", "0.90 m", "86 %", "1.2 %"} <= set(certificate_texts(apartment()))


def test_what_doors_leave_is_told_where_there_are_doors():
    assert "doors as they stand" in certificate_texts(with_door(30.0))
    assert "doors as they stand" not in certificate_texts(apartment())


def test_a_wish_is_told_with_both_figures():
    shown = certificate_texts(wishing(MET, UNMET))
    assert "Kitchen, aspect" in shown
    assert "4.00 x 4.00 m, 1:1 (wished 2:1)" in shown
    assert "16.1 m² (wished 16 m²)" in shown


def test_what_is_as_wished_is_said_once():
    same = MET.model_copy(update={"kind": "walls", "wished": "Brick", "found": "Brick"})
    assert "Brick" in certificate_texts(wishing(same))


def test_unmet_wishes_come_first_and_are_marked():
    classes = [found.get("class") for found in drawn_certificate(wishing(MET, UNMET, MET)).iter("g")]
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
    shown = certificate_texts(many)
    assert f"and {45 - MAX_WISHES + 1} more, fulfilled" in shown
    assert sum("wished 2:1" in text for text in shown) == 5
    assert "and 13 more, 13 of them not fulfilled" in certificate_texts(wishing(*([UNMET] * 40)))


def test_a_long_name_is_cut_and_what_was_wished_of_it_is_not():
    long = MET.model_copy(update={"subject": "x" * 200})
    (shown,) = [text for text in certificate_texts(wishing(long)) if text.startswith("xx")]
    assert shown.endswith("…, area")
    assert text_width(shown, 11.0) < 200


@pytest.mark.parametrize("count", [0, 1, 2, 27, 28, 60])
def test_the_panel_has_the_height_that_it_says(count: int):
    world = wishing(*([MET] * count))
    lowest = max(float(found.get("y", "nan")) for found in drawn_certificate(world).iter("text"))
    assert lowest <= certificate_height(world.certificate) < lowest + 30


def test_a_hostile_name_is_escaped():
    evil = MET.model_copy(update={"subject": "</svg><script>"})
    assert b"<script>" not in ET.tostring(drawn_certificate(wishing(evil)))


def test_a_certificate_without_wishes_has_no_heading():
    certificate: Certificate = apartment().certificate
    assert certificate.wishes == ()
    assert not any("wish" in text for text in certificate_texts(apartment()))
