"""Furniture as a drawing: on the plan with its name, and one thing alone from three sides."""

from typing import get_args
from xml.etree import ElementTree as ET

import pytest

from specs.data.world import Furniture, Rectangle, Solid
from specs.template.interior import ModelType
from tasks.export.drawing.furniture_symbols import draw_furniture, draw_piece_labels, in_words, solid_view_svg
from tasks.export.drawing.plan_page import PageBox, PageScale
from tests.factories.worlds import apartment, box

SHEET = PageScale(x_min_m=0.0, y_max_m=0.0, units_per_m=100.0, left=0.0, top=0.0)


def piece(width_m: float, depth_m: float, model_type: str = "SideboardsAndBuffets") -> Furniture:
    solid = box("it/top", (0.0, 0.0, 0.0), (width_m, depth_m, 0.5), (0.9, 0.9, 0.9))
    center_m = (width_m / 2, depth_m / 2)
    return Furniture(name="it", model_type=model_type, room="any", center_m=center_m, yaw_rad=0.0, solids=(solid,))


def labels(*pieces: Furniture, occupied: tuple[PageBox, ...] = ()) -> list[ET.Element]:
    root = ET.Element("g")
    draw_piece_labels(root, pieces, SHEET, occupied)
    return list(root)


@pytest.mark.parametrize(
    ("model_type", "words"),
    [
        ("Beds", "Bed"),
        ("StorageBenches", "Storage bench"),
        ("WashingMachinesAndDryers", "Washing machine and dryer"),
        ("Storage", "Storage"),
        ("MediaStorage", "Media storage"),
        ("DishWashers", "Dish washer"),
        ("EndAndSideTables", "End and side table"),
        ("aws_shelves_01", "aws shelves 01"),
    ],
)
def test_a_type_is_said_in_words(model_type: str, words: str):
    assert in_words(model_type) == words


@pytest.mark.parametrize("model_type", get_args(ModelType))
def test_every_type_is_said_as_one(model_type: str):
    assert not any(word.endswith("s") for word in in_words(model_type).split())


def test_a_name_that_does_not_fit_is_shortened_turned_or_left_out():
    (long,) = labels(piece(2.0, 0.5))
    (short,) = labels(piece(0.8, 0.3))
    (upright,) = labels(piece(0.3, 0.8))
    assert long.text == "Sideboard and buffet"
    assert short.text == upright.text == "Sideboard"
    assert "rotate(-90" in upright.get("transform", "")
    assert labels(piece(0.3, 0.3)) == []


def test_a_name_lies_where_it_can():
    (label,) = labels(piece(0.9, 1.6, "Beds"))
    assert label.get("transform") is None


def test_a_name_covers_no_other_text():
    over = PageBox(0.0, -60.0, 200.0, 0.0)
    assert labels(piece(2.0, 0.5), occupied=(over,)) == []
    assert len(labels(piece(2.0, 0.5), piece(2.0, 0.5))) == 1


def test_solids_are_drawn_from_the_lowest_to_the_highest():
    sofa = apartment().furniture[0]
    root = ET.Element("g")
    draw_furniture(root, [sofa.model_copy(update={"solids": sofa.solids[::-1]})], SHEET)
    depths = [float(found.get("height", "nan")) for found in root.iter("rect")]
    assert depths == [pytest.approx(90.0), pytest.approx(20.0)]


SVG = "{http://www.w3.org/2000/svg}"
RED, BLUE = (0.8, 0.1, 0.1), (0.1, 0.1, 0.8)


def solid_box(
    x: float, y: float, z: float, color: tuple[float, float, float] = RED, *, half: float = 0.5, yaw: float = 0.0
) -> Solid:
    return Solid(
        name="box",
        shape="box",
        center_m=(x, y, z),
        half_extents_m=(half, half, half),
        yaw_rad=yaw,
        color=color,
    )


def drawn(*solids: Solid, clear: Rectangle | None = None) -> ET.Element:
    return ET.fromstring(solid_view_svg("a thing", solids, clear))  # noqa: S314 - our own document


def faces(*solids: Solid, clear: Rectangle | None = None) -> list[ET.Element]:
    root = drawn(*solids, clear=clear)
    return [*root.iter(f"{SVG}path"), *root.iter(f"{SVG}ellipse")]


def order(*solids: Solid) -> str:
    """Returns the colours of all faces in the order in which they are drawn: r for red, b for blue."""
    fills = [face.get("fill", "") for face in faces(*solids)]
    return "".join("r" if fill[1:3] > fill[5:7] else "b" for fill in fills)


def test_one_sees_three_faces_of_a_box_and_the_wall_and_the_top_of_a_cylinder():
    assert len(faces(solid_box(0, 0, 0.5))) == 3
    assert len(faces(solid_box(0, 0, 0.5, yaw=0.7))) == 3
    assert len(faces(solid_box(0, 0, 0.5).model_copy(update={"shape": "cylinder"}))) == 2


@pytest.mark.parametrize(
    "nearer", [(1.0, 0.0, 0.5), (0.0, 1.0, 0.5), (0.0, 0.0, 1.5)], ids=["beside", "before", "above"]
)
def test_what_is_nearer_to_the_eye_is_drawn_last(nearer: tuple[float, float, float]):
    far, near = solid_box(0, 0, 0.5, BLUE), solid_box(*nearer, RED)
    assert order(far, near) == order(near, far) == "bbbrrr"


def test_a_small_thing_on_a_large_one_is_drawn_after_it_wherever_it_lies():
    table = solid_box(0, 0, 0.5, BLUE, half=0.5)
    cup = solid_box(-0.4, -0.4, 1.05, RED, half=0.05)
    assert order(cup, table) == "bbbrrr"


def test_things_that_overlap_are_drawn_all_the_same():
    assert len(faces(*(solid_box(0.1 * n, 0, 0.5) for n in range(5)))) == 15


def test_the_floor_that_is_kept_free_is_outlined_below_all_else():
    floor = Rectangle(x_min_m=-1, x_max_m=1, y_min_m=0.5, y_max_m=1.5)
    found = faces(solid_box(0, 0, 0.5), clear=floor)
    assert [face.get("class") for face in found] == ["clear", None, None, None]


def test_a_metre_is_as_long_in_each_picture():
    one, two = (drawn(solid_box(0, 0, 1, half=half)).get("width", "") for half in (0.5, 1.0))
    assert float(two) - 16 == pytest.approx(2 * (float(one) - 16), abs=1.5)
