"""Interiors are tried again room by room until a robot gets everywhere."""

from tasks.worlds.brief import Brief, brief_of
from tasks.worlds.floorplan import plan_floor
from tasks.worlds.interior import Draw, furnish_interior
from tasks.worlds.walls import build_walls
from tests.worlds.templates import MODEL_TYPES, furniture, room, template

NAMES = ("A", "B", "C")
GREY = (0.5, 0.5, 0.5)


def crowded() -> Brief:
    arrangement = furniture({"RoomNames": list(NAMES)}, list(MODEL_TYPES), "Dense")
    return brief_of(template(*(room(name, area_m2=10.0) for name in NAMES), arrangements=(arrangement,)))


def test_an_interior_is_the_same_each_time() -> None:
    brief = crowded()
    plan = plan_floor(brief, 1, 1)
    walls = build_walls(plan, 3.0, [GREY] * 3)
    once, again = (furnish_interior(brief, plan, walls, Draw(1, 1, 4)).furniture for _ in range(2))
    assert once == again


def test_names_are_numbered_by_type_across_rooms() -> None:
    brief = crowded()
    plan = plan_floor(brief, 2, 1)
    pieces = furnish_interior(brief, plan, build_walls(plan, 3.0, [GREY] * 3), Draw(2, 1, 1)).furniture
    assert len({piece.name for piece in pieces}) == len(pieces)
    assert all(piece.name.rsplit("_", 1)[0] == piece.model_type for piece in pieces)
