"""What a room is furnished with: by its type, or by the template's list."""

from dataclasses import replace

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
from tasks.worlds.furniture.furniture_type import likely
from tests.worlds.templates import ROOM_TYPES


@pytest.mark.parametrize("kind", ROOM_TYPES)
def test_programmes_name_known_types(kind: RoomType) -> None:
    programme = ROOM_DEFAULTS[kind]
    assert {each for choice in programme.essential for each in choice} <= set(CATALOGUE)
    assert {*programme.likely, *programme.occasional} <= set(CATALOGUE)


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
