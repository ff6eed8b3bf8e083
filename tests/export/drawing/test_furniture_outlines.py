"""Furniture is named where its name fits."""

from typing import get_args
from xml.etree import ElementTree as ET

import pytest

from specs.data.world import Furniture
from specs.template.interior import ModelType
from tasks.export.drawing.furniture_drawing import draw_furniture, draw_piece_labels, in_words
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
