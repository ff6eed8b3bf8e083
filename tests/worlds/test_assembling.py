"""Pieces become primitives in the world, turned as the piece is."""

import math

import numpy as np
import pytest

from specs.world import Furniture
from tasks.worlds.assembling import assemble
from tasks.worlds.geometry import Box
from tasks.worlds.parts import Tints
from tasks.worlds.placing import Piece
from tests.worlds.geometry_checks import polygon

TINTS = Tints((0.5, 0.4, 0.3), (0.4, 0.3, 0.2), (0.2, 0.3, 0.4))
NOWHERE = Box(0.0, 0.0, 0.0, 0.0)


def sofa(quarter: int, askew_rad: float = 0.0) -> Furniture:
    piece = Piece("Sofas", (2.0, 0.9, 0.8), (5.0, 3.0), quarter, askew_rad, NOWHERE, NOWHERE)
    return assemble(piece, "Sofas_1", "Room", TINTS)


@pytest.mark.parametrize(("quarter", "behind"), [(0, (0, -1)), (1, (1, 0)), (2, (0, 1)), (3, (-1, 0))])
def test_the_back_of_a_sofa_is_behind_what_it_faces(quarter: int, behind: tuple[int, int]) -> None:
    made = sofa(quarter)
    back = next(solid for solid in made.solids if solid.name == "Sofas_1_back")
    offset = np.subtract(back.center_m[:2], made.center_m)
    np.testing.assert_allclose(offset, 0.35 * np.array(behind), atol=1e-6)
    facing = (-math.sin(made.yaw_rad), math.cos(made.yaw_rad))
    np.testing.assert_allclose(facing, (-behind[0], -behind[1]), atol=1e-5)


@pytest.mark.parametrize("quarter", range(4))
def test_quarter_turns_leave_boxes_without_yaw(quarter: int) -> None:
    assert {solid.yaw_rad for solid in sofa(quarter).solids} == {0.0}


def test_a_piece_askew_covers_the_same_outline_turned() -> None:
    straight, askew = sofa(1), sofa(1, 0.2)
    turn = np.array([[math.cos(0.2), math.sin(0.2)], [-math.sin(0.2), math.cos(0.2)]])
    for before, after in zip(straight.solids, askew.solids, strict=True):
        turned = (polygon(before) - straight.center_m) @ turn + straight.center_m
        found = polygon(after)
        assert all(np.linalg.norm(found - corner, axis=1).min() < 1e-5 for corner in turned)


def test_primitives_carry_the_name_of_their_piece() -> None:
    assert all(solid.name.startswith("Sofas_1_") for solid in sofa(0).solids)
