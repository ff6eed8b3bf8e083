"""Rooms are furnished from their programme or list, up to a density and a number of primitives."""

import numpy as np
import pytest

from specs.template_interior import Density
from specs.world import RoomType
from tasks.worlds.brief import RoomWish
from tasks.worlds.catalogue import CATALOGUE
from tasks.worlds.furnishing import count_solids, furnish
from tasks.worlds.geometry import Box
from tasks.worlds.placing import Piece
from tests.worlds.templates import MODEL_TYPES, ROOM_TYPES

FLOOR = Box(10.0, 10.0, 16.0, 15.0)
DOOR = Box(12.0, 9.5, 13.0, 10.8)


def furnished(
    kind: RoomType = "Living",
    listed: tuple[str, ...] | None = None,
    *,
    seed: int = 1,
    solids: int = 60,
    density: float = 0.2,
    wish: Density = "Moderate",
) -> tuple[Piece, ...]:
    room = RoomWish("Room", kind, FLOOR.area, 1.2, (), (), listed, wish)
    return furnish(np.random.default_rng(seed), room, FLOOR, (DOOR,), solids=solids, density=density)


@pytest.mark.parametrize("kind", ROOM_TYPES)
@pytest.mark.parametrize("seed", range(4))
def test_pieces_stand_apart_inside_the_room_and_off_the_door(kind: RoomType, seed: int) -> None:
    pieces = furnished(kind, seed=seed)
    assert pieces
    for number, piece in enumerate(pieces):
        assert not piece.body.meets(DOOR)
        assert not any(piece.body.meets(other.body) for other in pieces[:number])
        assert piece.body.x_min >= FLOOR.x_min
        assert piece.body.y_max <= FLOOR.y_max


@pytest.mark.parametrize(
    ("kind", "expected"),
    [("Bedroom", "Beds"), ("Bathroom", "Toilets"), ("Living", "Sofas"), ("Dining", "DiningTables")],
)  # fmt: skip
def test_a_room_has_what_makes_it_that_room(kind: RoomType, expected: str) -> None:
    for seed in range(6):
        assert expected in {piece.type for piece in furnished(kind, seed=seed)}


def test_only_listed_types_stand_companions_included() -> None:
    assert {piece.type for piece in furnished("Bedroom", ("Beds",))} == {"Beds"}
    assert {piece.type for piece in furnished("Bedroom", ("Nightstands", "Beds"))} == {"Beds", "Nightstands"}


def test_an_empty_list_furnishes_nothing() -> None:
    assert furnished("Bedroom", ()) == ()


def test_primitives_stay_within_their_budget() -> None:
    for seed in range(6):
        pieces = furnished("Dining", seed=seed, solids=15, density=0.6)
        assert sum(count_solids(piece.type) for piece in pieces) <= 15


def test_the_density_bounds_the_covered_floor() -> None:
    for density in (0.1, 0.2, 0.3):
        covered = sum(piece.size[0] * piece.size[1] for piece in furnished("Bedroom", density=density))
        assert 0.5 * density < covered / FLOOR.area < 1.6 * density


def test_sizes_are_those_of_the_catalogue() -> None:
    for piece in furnished("Living", MODEL_TYPES, solids=200, density=0.5):
        model = CATALOGUE[piece.type]
        for extent, (low, high) in zip(piece.size, (model.width_m, model.depth_m, model.height_m), strict=True):
            assert low - 0.005 <= extent <= high + 0.005
