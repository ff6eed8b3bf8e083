"""Materials are known by RoboMaker's names, however they are spelled."""

import pytest
from pydantic import JsonValue

from tasks.worlds.brief import Brief, brief_of
from tasks.worlds.materials import FLOORINGS, WALLS, draw_surfaces
from tests.worlds.templates import materials, room, template


def with_materials(floor: str, wall: str) -> Brief:
    target: dict[str, JsonValue] = {"RoomNames": ["A"]}
    return brief_of(template(room("A"), flooring=(materials(target, floor),), walls=(materials(target, wall),)))


def test_there_are_six_floorings_and_seven_wall_materials() -> None:
    assert (len(FLOORINGS), len(WALLS)) == (6, 7)


@pytest.mark.parametrize(("written", "known"), [("WALLPAPER", "Wallpaper"), ("wood Panels", "Wood panels")])
def test_case_and_spaces_do_not_matter(written: str, known: str) -> None:
    surfaces, unmet = draw_surfaces(with_materials("tiles", written), seed=1, floorplan_index=1, interior_index=1)
    assert (surfaces[0].floor, surfaces[0].wall) == ("Tiles", known)
    assert unmet == ()


def test_an_unknown_material_is_replaced_and_named() -> None:
    surfaces, unmet = draw_surfaces(with_materials("Lava", "Brick"), seed=1, floorplan_index=1, interior_index=1)
    assert surfaces[0].floor in FLOORINGS
    assert len(unmet) == 1
    assert "'Lava'" in unmet[0]
    assert "Parquetry" in unmet[0]


def test_interiors_differ_in_their_materials() -> None:
    brief = brief_of(template(*(room(f"R{n}") for n in range(6))))
    drawn = {draw_surfaces(brief, seed=1, floorplan_index=1, interior_index=n)[0] for n in range(1, 6)}
    assert len(drawn) > 1
