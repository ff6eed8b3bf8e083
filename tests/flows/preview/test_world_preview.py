"""The list of furniture says what the generator places: every kind, within its sizes, in its rooms."""

import pytest

from flows.preview.world_preview import FURNITURE_KINDS, furniture_kinds, furniture_picture
from tasks.worlds.furniture.catalogue import CATALOGUE, ROOM_DEFAULTS
from tasks.worlds.generate import generate_world
from tests.worlds.templates import furniture, room, template

BY_NAME = {each.kind: each for each in furniture_kinds()}


def test_every_kind_is_listed_once():
    assert list(BY_NAME) == list(FURNITURE_KINDS)
    assert set(FURNITURE_KINDS) == set(CATALOGUE)


def test_rooms_are_those_of_the_programmes():
    for kind, listed in BY_NAME.items():
        for name, programme in ROOM_DEFAULTS.items():
            assert (name in listed.essential) == any(kind in choice for choice in programme.essential)
            assert (name in listed.likely) == (kind in programme.likely and name not in listed.essential)


@pytest.mark.parametrize("kind", ["Sofas", "Ottomans", "Storage", "Showers"])
def test_what_stands_in_worlds_is_within_the_sizes(kind: str):
    body = template(room("A", area_m2=25.0), arrangements=(furniture({"RoomNames": ["A"]}, [kind], "Dense"),))
    world = generate_world(body, seed=1, generation="g", floorplan_index=1, interior_index=1)
    assert world.furniture
    for piece in world.furniture:
        tops = [solid.center_m[2] + solid.half_extents_m[2] for solid in piece.solids]
        low, high = BY_NAME[kind].height_m
        assert low - 0.01 <= max(tops) <= high + 0.01


def test_a_picture_is_small_and_the_same_each_time():
    drawn = [furniture_picture(kind) for kind in FURNITURE_KINDS]
    assert max(map(len, drawn)) < 6_000
    assert drawn == [furniture_picture(kind) for kind in FURNITURE_KINDS]
