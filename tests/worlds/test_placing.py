"""Pieces stand against walls, out of the way, and companions stand with their owners."""

import math

import numpy as np
import pytest

from tasks.worlds.catalogue import CATALOGUE
from tasks.worlds.furnishing import draw_size
from tasks.worlds.geometry import Box
from tasks.worlds.placing import Piece, Scene, place, place_companion, turned

# Far from (0, 0), so that the disc around the start is not in the way.
FLOOR = Box(10.0, 10.0, 15.0, 14.0)


def stand(kind: str, scene: Scene, seed: int) -> Piece | None:
    rng = np.random.default_rng(seed)
    return place(rng, scene, kind, CATALOGUE[kind], draw_size(rng, kind))


@pytest.mark.parametrize("seed", range(8))
def test_a_sofa_has_its_back_at_a_wall_and_faces_the_room(seed: int) -> None:
    piece = stand("Sofas", Scene(FLOOR, ()), seed)
    assert piece is not None
    backs = (
        piece.body.y_min - FLOOR.y_min,
        FLOOR.x_max - piece.body.x_max,
        FLOOR.y_max - piece.body.y_max,
        piece.body.x_min - FLOOR.x_min,
    )
    assert backs[piece.quarter] == pytest.approx(0.02, abs=1e-3)


@pytest.mark.parametrize("seed", range(8))
def test_a_dining_table_leaves_room_to_sit_all_around(seed: int) -> None:
    piece = stand("DiningTables", Scene(FLOOR, ()), seed)
    assert piece is not None
    around = piece.body.grown(0.85)
    assert around.x_min >= FLOOR.x_min
    assert around.y_max <= FLOOR.y_max


def test_nothing_stands_where_floor_is_kept_clear() -> None:
    keep = Box(10.0, 10.0, 12.0, 14.0)
    for seed in range(20):
        piece = stand("Storage", Scene(FLOOR, (keep,)), seed)
        assert piece is None or not piece.body.meets(keep)


def test_a_full_room_takes_no_more() -> None:
    assert stand("Beds", Scene(FLOOR, (FLOOR,)), 1) is None


def test_nothing_stands_within_the_disc_around_the_start() -> None:
    scene = Scene(Box(-2.0, -2.0, 2.0, 2.0), ())
    for seed in range(30):
        piece = stand("Nightstands", scene, seed)
        if piece is not None:
            x = max(piece.body.x_min, -piece.body.x_max, 0.0)
            y = max(piece.body.y_min, -piece.body.y_max, 0.0)
            assert math.hypot(x, y) >= 1.0


def test_chairs_face_the_table_they_stand_at() -> None:
    scene = Scene(Box(10.0, 10.0, 16.0, 16.0), ())
    table = stand("DiningTables", scene, 3)
    assert table is not None
    scene.pieces.append(table)
    seats = [place_companion(scene, table, each, (0.45, 0.45, 0.9)) for each in CATALOGUE["DiningTables"].companions]
    assert all(seats)
    for seat in seats:
        assert seat is not None
        facing = turned((0.0, 1.0), seat.quarter)
        to_table = np.subtract(table.center, seat.center)
        assert float(np.dot(facing, to_table)) == pytest.approx(float(np.linalg.norm(to_table)), abs=1e-6)


def test_a_companion_gives_up_a_place_that_is_taken() -> None:
    scene = Scene(Box(10.0, 10.0, 16.0, 16.0), ())
    table = stand("DiningTables", scene, 3)
    assert table is not None
    seat = place_companion(scene, table, CATALOGUE["DiningTables"].companions[0], (0.45, 0.45, 0.9))
    assert seat is not None
    scene.pieces += [table, seat]
    assert place_companion(scene, table, CATALOGUE["DiningTables"].companions[0], (0.45, 0.45, 0.9)) is None


def test_the_screen_stands_across_from_the_sofa() -> None:
    facing = 0
    for seed in range(10):
        scene = Scene(FLOOR, ())
        sofa = stand("Sofas", scene, seed)
        assert sofa is not None
        scene.pieces.append(sofa)
        screen = stand("MediaStorage", scene, seed + 100)
        facing += screen is not None and screen.quarter == (sofa.quarter + 2) % 4
    assert facing >= 8


def test_kitchen_units_stand_flush_in_a_row() -> None:
    scene = Scene(FLOOR, ())
    first = stand("Fridges", scene, 2)
    assert first is not None
    scene.pieces.append(first)
    second = stand("Ovens", scene, 3)
    assert second is not None
    assert second.quarter == first.quarter
    gap = max(second.body.x_min - first.body.x_max, first.body.x_min - second.body.x_max,
              second.body.y_min - first.body.y_max, first.body.y_min - second.body.y_max)  # fmt: skip
    assert 0.0 <= gap < 0.02


def test_quarter_turns_are_exact() -> None:
    assert [turned((1.0, 2.0), quarter) for quarter in range(5)] == [
        (1.0, 2.0),
        (-2.0, 1.0),
        (-1.0, -2.0),
        (2.0, -1.0),
        (1.0, 2.0),
    ]
