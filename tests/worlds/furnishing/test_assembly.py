"""Pieces become primitives in the world, turned as the piece is, in the colours of the room."""

import math

import numpy as np
import pytest

from specs.data.world import Furniture, Solid
from tasks.worlds.furnishing.assembly import Look, Palette, assemble, draw_look
from tasks.worlds.furnishing.scene import Piece
from tasks.worlds.furniture.catalogue import compose
from tasks.worlds.furniture.furniture_type import Style
from tasks.worlds.geometry import rounded
from tests.worlds.geometry_checks import polygon
from tests.worlds.rooms import LOOK, NOWHERE, standing

SOFA = (2.0, 0.9, 0.8)


def sofa(quarter: int, askew_rad: float = 0.0) -> Furniture:
    return standing("Sofas", SOFA, quarter, askew_rad)


@pytest.mark.parametrize(("quarter", "behind"), [(0, (0, -1)), (1, (1, 0)), (2, (0, 1)), (3, (-1, 0))])
def test_the_back_of_a_sofa_is_behind_what_it_faces(quarter: int, behind: tuple[int, int]) -> None:
    made = sofa(quarter)
    back = next(solid for solid in made.solids if solid.name == "Sofas_1_back")
    offset = np.subtract(back.center_m[:2], made.center_m)
    np.testing.assert_allclose(offset, 0.35 * np.array(behind), atol=1e-6)
    facing = (-math.sin(made.yaw_rad), math.cos(made.yaw_rad))
    np.testing.assert_allclose(facing, (-behind[0], -behind[1]), atol=1e-5)


@pytest.mark.parametrize("width_m", [0.9, 0.95, 1.000001, 0.912345678, 1.0000005, 1 / 3])
@pytest.mark.parametrize("center", [(5.0, 3.0), (-2.345, 0.001), (1.2345, 0.0), (0.1 + 0.2, -1e-7)])
def test_primitives_stand_where_their_rounded_sum_is(width_m: float, center: tuple[float, float]) -> None:
    size = (width_m, 0.35, 1.8)
    made = assemble(Piece("Bookcases", size, center, 0, 0.0, NOWHERE), "b", "Room", LOOK)
    for solid, part in zip(made.solids, compose("Bookcases", size, LOOK.style), strict=True):
        wanted = tuple(rounded(own + moved) for own, moved in zip(center, part.center[:2], strict=True))
        assert solid.center_m[:2] == wanted


@pytest.mark.parametrize("quarter", range(4))
def test_quarter_turns_leave_boxes_without_yaw(quarter: int) -> None:
    assert {solid.yaw_rad for solid in sofa(quarter).solids} == {0.0}


@pytest.mark.parametrize("quarter", range(4))
def test_a_chair_turns_the_spokes_of_its_star_along(quarter: int) -> None:
    straight, turned = (standing("DeskChairs", (0.6, 0.6, 0.9), turn) for turn in (0, quarter))
    for before, after in zip(straight.solids, turned.solids, strict=True):
        found = polygon(after) - turned.center_m
        for x, y in polygon(before) - straight.center_m:
            corner = ((x, y), (-y, x), (-x, -y), (y, -x))[quarter]
            assert np.linalg.norm(found - corner, axis=1).min() < 1e-5


def test_a_piece_askew_covers_the_same_outline_turned() -> None:
    straight, askew = sofa(1), sofa(1, 0.2)
    turn = np.array([[math.cos(0.2), math.sin(0.2)], [-math.sin(0.2), math.cos(0.2)]])
    for before, after in zip(straight.solids, askew.solids, strict=True):
        turned = (polygon(before) - straight.center_m) @ turn + straight.center_m
        found = polygon(after)
        assert all(np.linalg.norm(found - corner, axis=1).min() < 1e-5 for corner in turned)


def test_primitives_carry_the_name_of_their_piece() -> None:
    assert all(solid.name.startswith("Sofas_1_") for solid in sofa(0).solids)


def test_solids_are_as_the_document_demands() -> None:
    for solid in sofa(3, 0.2).solids:
        assert Solid.model_validate(solid.model_dump()) == solid
        assert all(value == round(value, 6) for value in (*solid.center_m, *solid.half_extents_m, *solid.color))


def test_upholstery_has_the_colours_of_the_room() -> None:
    red, blue = (0.8, 0.1, 0.1), (0.1, 0.1, 0.8)
    look = Look(LOOK.style, Palette(*LOOK.palette[:3], fabric=red, cushion=blue))
    colors = {solid.name.removeprefix("Sofas_1_"): solid.color for solid in standing("Sofas", SOFA, look=look).solids}
    assert colors["back"] == red
    assert colors["cushion_1"] == blue


def test_rooms_look_unlike_each_other() -> None:
    looks = [draw_look(np.random.default_rng(seed)) for seed in range(40)]
    assert {look.style for look in looks} == {Style(a, b) for a in (False, True) for b in (False, True)}
    assert len({look.palette for look in looks}) > 4
