"""Of the free places, a group gets the one that it likes best."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.worlds.floorplan.floorplan import Pane
from tasks.worlds.furnishing.groups import FurnitureGroup, Member
from tasks.worlds.furnishing.placement import place_group
from tasks.worlds.furnishing.scene import Piece, PlacedGroup, RoomScene, open_scene
from tasks.worlds.furniture.furniture_type import Taste
from tasks.worlds.geometry import Box
from tests.worlds.rooms import empty_scene

SEEDS = range(6)


def stand(scene: RoomScene, taste: Taste, seed: int, kind: str = "Dressers") -> Piece:
    group = FurnitureGroup((Member(kind, (1.0, 0.5, 0.8)),), (), taste=replace(taste, chance=0.1))
    found = place_group(np.random.default_rng(seed), scene, group)
    assert found is not None
    return found.pieces[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_who_likes_corners_stands_in_one(seed: int) -> None:
    piece = stand(empty_scene(5.0, 4.0), Taste(corner=1.0), seed)
    x, y = min(piece.body.x_min - 10.0, 15.0 - piece.body.x_max), min(piece.body.y_min - 10.0, 14.0 - piece.body.y_max)
    assert max(x, y) == pytest.approx(0.02)


@pytest.mark.parametrize("seed", SEEDS)
def test_who_likes_the_middle_stands_there(seed: int) -> None:
    piece = stand(empty_scene(5.0, 4.0), Taste(middle=1.0), seed)
    middle = (12.5, 12.0)[piece.quarter % 2]
    assert piece.center[piece.quarter % 2] == pytest.approx(middle, abs=0.3)


@pytest.mark.parametrize("seed", SEEDS)
def test_who_likes_light_stands_below_the_window(seed: int) -> None:
    lit = open_scene(empty_scene(5.0, 4.0).floor, (), 0.25, [Pane(0, (11.5, 14.06), 1.2, "x", 0.9, 2.1)])
    piece = stand(lit, Taste(window=1.0, middle=0.2), seed)
    assert piece.quarter == 2
    assert piece.center[0] < 12.6


@pytest.mark.parametrize("seed", SEEDS)
def test_who_likes_company_stands_near_it(seed: int) -> None:
    scene = empty_scene(8.0, 4.0)
    scene.add(PlacedGroup((Piece("Beds", (1.0, 2.0, 1.0), (10.6, 11.1), 0, 0.0, Box(10.1, 10.1, 11.1, 12.1)),), ()))
    piece = stand(scene, Taste(near=("Beds",)), seed)
    assert piece.center[0] < 13.0


@pytest.mark.parametrize("seed", SEEDS)
def test_lamps_keep_away_from_lamps(seed: int) -> None:
    scene = empty_scene(8.0, 4.0)
    scene.add(
        PlacedGroup((Piece("FloorLamps", (0.4, 0.4, 1.6), (10.3, 10.3), 0, 0.0, Box(10.1, 10.1, 10.5, 10.5)),), ())
    )
    piece = stand(scene, Taste(apart=True), seed, "FloorLamps")
    assert np.hypot(piece.center[0] - 10.3, piece.center[1] - 10.3) > 2.5


@pytest.mark.parametrize("seed", SEEDS)
def test_a_screen_stands_across_from_the_sofa(seed: int) -> None:
    scene = empty_scene(5.0, 4.0)
    scene.add(PlacedGroup((Piece("Sofas", (2.0, 0.9, 0.8), (12.5, 10.5), 0, 0.0, Box(11.5, 10.02, 13.5, 10.92)),), ()))
    piece = stand(scene, Taste(facing="Sofas"), seed)
    assert piece.quarter == 2
    assert piece.center[0] == pytest.approx(12.5, abs=0.5)


@pytest.mark.parametrize("seed", SEEDS)
def test_nobody_stands_in_the_middle_of_a_room_while_walls_are_free(seed: int) -> None:
    piece = stand(empty_scene(8.0, 8.0), Taste(), seed)
    assert min(piece.body.x_min - 10, 18 - piece.body.x_max, piece.body.y_min - 10, 18 - piece.body.y_max) < 0.03
