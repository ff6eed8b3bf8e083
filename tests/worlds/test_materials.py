"""Materials are known by RoboMaker's names, however they are spelled."""

import numpy as np
import pytest
from pydantic import JsonValue

from tasks.worlds.materials import FLOORINGS, WALLS, draw_surfaces
from tasks.worlds.resolved_template import ResolvedTemplate, resolve_template
from tests.worlds.templates import materials, room, template


def with_materials(floor: str, wall: str) -> ResolvedTemplate:
    target: dict[str, JsonValue] = {"RoomNames": ["A"]}
    return resolve_template(template(room("A"), flooring=(materials(target, floor),), walls=(materials(target, wall),)))


def test_there_are_six_floorings_and_seven_wall_materials() -> None:
    assert (len(FLOORINGS), len(WALLS)) == (6, 7)


@pytest.mark.parametrize(("written", "known"), [("WALLPAPER", "Wallpaper"), ("wood Panels", "Wood panels")])
def test_case_and_spaces_do_not_matter(written: str, known: str) -> None:
    (surfaces,) = draw_surfaces(with_materials("tiles", written), np.random.default_rng(1))
    assert (surfaces.flooring.material, surfaces.walls.material) == ("Tiles", known)


def test_an_unknown_material_is_replaced_by_one_that_suits_the_room() -> None:
    (surfaces,) = draw_surfaces(with_materials("Lava", "Brick"), np.random.default_rng(1))
    assert surfaces.flooring.material in FLOORINGS


def test_a_covering_has_the_figures_of_its_material() -> None:
    (surfaces,) = draw_surfaces(with_materials("Tiles", "Brick"), np.random.default_rng(1))
    found = surfaces.walls
    assert (found.pattern, found.repeat_m) == (WALLS["Brick"].pattern, WALLS["Brick"].repeat_m)
    assert (found.color, found.accent) in WALLS["Brick"].schemes


def test_two_rooms_of_one_material_need_not_look_alike() -> None:
    resolved = resolve_template(
        template(*(room(f"R{n}") for n in range(6)), walls=(materials({"RoomTypes": ["Living"]}, "Wall paint"),))
    )
    assert len({each.walls.color for each in draw_surfaces(resolved, np.random.default_rng(1))}) > 1


def test_interiors_differ_in_their_materials() -> None:
    resolved = resolve_template(template(*(room(f"R{n}") for n in range(6))))
    drawn = {draw_surfaces(resolved, np.random.default_rng(n)) for n in range(1, 6)}
    assert len(drawn) > 1
