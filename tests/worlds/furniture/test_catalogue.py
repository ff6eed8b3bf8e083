"""The catalogue has every type of templates, and each room type has furniture by default."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from specs.data.world import RoomType
from tasks.worlds.furniture.catalogue import (
    CATALOGUE,
    ROOM_DEFAULTS,
    draw_listed_furniture,
    draw_usual_furniture,
    room_defaults_of,
)
from tasks.worlds.furniture.furniture_type import STEP_M, likely
from tests.specs.own_words import robomakers_words
from tests.worlds.templates import MODEL_TYPES, ROOM_TYPES


def widths(kind: str) -> set[float]:
    return {width for variant in CATALOGUE[kind].variants for width in variant.sizes[0]}


def test_the_catalogue_holds_exactly_the_types_of_the_template() -> None:
    assert set(CATALOGUE) == set(MODEL_TYPES)
    assert len(robomakers_words([*CATALOGUE])) == 31


@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_sizes_come_in_steps_of_five_centimetres(kind: str) -> None:
    for variant in CATALOGUE[kind].variants:
        for extents, (low, high) in zip(
            variant.sizes, (variant.width_m, variant.depth_m, variant.height_m), strict=True
        ):
            assert extents[0] == low
            assert math.isclose(extents[-1], high, abs_tol=1e-9)
            assert all(math.isclose(b - a, STEP_M) for a, b in pairwise(extents))


@pytest.mark.parametrize("area_m2", [1.0, 10.0, 60.0, 300.0])
@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_every_type_has_a_usual_size_in_every_room(kind: str, area_m2: float) -> None:
    assert CATALOGUE[kind].usual(area_m2)


def test_kitchen_units_are_modules_of_the_norm() -> None:
    for kind in ("Ovens", "DishWashers"):
        assert all(math.isclose(round(width * 10), width * 10) for width in (0.6, 1.2))
        assert min(widths(kind)) == 0.6
        assert {variant.depth_m for variant in CATALOGUE[kind].variants} == {(0.6, 0.6)}


def test_beds_are_mattresses_of_usual_width_in_a_frame() -> None:
    assert {round(width - 0.1, 2) for width in widths("Beds")} == {0.9, 1.4, 1.6, 1.8}


def test_large_beds_are_for_large_rooms() -> None:
    small, large = (max(variant.width_m[1] for variant in CATALOGUE["Beds"].usual(area)) for area in (10.0, 20.0))
    assert (small, large) == (1.0, 1.9)


@pytest.mark.parametrize("kind", ROOM_TYPES)
def test_programmes_name_known_types(kind: RoomType) -> None:
    defaults = ROOM_DEFAULTS[kind]
    assert {each for choice in defaults.essential for each in choice} <= set(CATALOGUE)
    assert {*defaults.likely, *defaults.occasional} <= set(CATALOGUE)


def test_what_makes_a_room_comes_first_in_its_order() -> None:
    first, rest = draw_usual_furniture(np.random.default_rng(1), "Kitchen")
    assert first == ["Ovens", "DishWashers", "Fridges"]
    assert set(rest) == {*ROOM_DEFAULTS["Kitchen"].likely, *ROOM_DEFAULTS["Kitchen"].occasional}


def test_of_several_essentials_in_one_place_one_is_drawn() -> None:
    drawn = {draw_usual_furniture(np.random.default_rng(seed), "Bathroom")[0][2] for seed in range(30)}
    assert drawn == {"Showers", "Baths"}


def test_a_list_is_tried_whole_with_what_makes_the_room_first() -> None:
    first, rest = draw_listed_furniture(np.random.default_rng(1), "Bedroom", ("Ottomans", "Beds", "Desks", "Beds"))
    assert first[0] == "Beds"
    assert sorted(first) == sorted(rest) == ["Beds", "Desks", "Ottomans"]


def test_each_type_of_a_list_is_first_some_time() -> None:
    listed = ("Ottomans", "Sofas", "Desks")
    assert {draw_listed_furniture(np.random.default_rng(seed), "Closet", listed)[0][0] for seed in range(40)} == set(
        listed
    )


def test_the_record_of_a_new_type_brings_it_into_its_rooms(monkeypatch: pytest.MonkeyPatch) -> None:
    piano = replace(CATALOGUE["SideboardsAndBuffets"], name="Pianos", rooms=(likely("Living", 20.0),))
    monkeypatch.setitem(CATALOGUE, "Pianos", piano)
    assert list(room_defaults_of("Living").likely.items())[-1] == ("Pianos", 20.0)
    assert "Pianos" not in room_defaults_of("Bedroom").likely
