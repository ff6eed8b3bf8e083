"""Rooms are furnished from their programme or list, up to a density and a number of primitives."""

import numpy as np
import pytest

from specs.data.world import RoomType
from tasks.worlds.furnishing.furnish import furnish
from tasks.worlds.furnishing.placement import robot_gets_around
from tasks.worlds.furnishing.scene import RoomScene, open_scene
from tasks.worlds.furniture.catalogue import compose
from tasks.worlds.geometry import Box
from tasks.worlds.resolved_template import RoomWish
from tests.worlds.rooms import LOOK, ROBOT_M
from tests.worlds.templates import ROOM_TYPES

FLOOR = Box(10.0, 10.0, 16.0, 15.0)
DOOR = Box(12.0, 9.5, 13.0, 10.9)
ENTRY = (12.5, 10.0)


def furnished(
    kind: RoomType = "Living",
    listed: tuple[str, ...] | None = None,
    *,
    seed: int = 1,
    solids: int = 200,
    density: float = 0.2,
    floor: Box = FLOOR,
    radius_m: float = ROBOT_M,
) -> RoomScene:
    wish = RoomWish("Room", kind, floor.area, 1.2, (), (), listed, "Moderate")
    scene = open_scene(floor, (DOOR,), radius_m, (), (ENTRY,))
    furnish(np.random.default_rng(seed), wish, scene, LOOK.style, solids=solids, density=density, radius_m=radius_m)
    return scene


def types(scene: RoomScene) -> list[str]:
    return [piece.type for piece in scene.pieces]


def covered(scene: RoomScene) -> float:
    return sum(piece.covers_m2 for piece in scene.pieces) / scene.floor.area


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("Bedroom", {"Beds", "Storage"}),
        ("Bathroom", {"Toilets", "VanityCounters"}),
        ("Living", {"Sofas", "MediaStorage"}),
        ("Dining", {"DiningTables", "DiningChairs"}),
        ("Kitchen", {"Fridges", "Ovens", "DishWashers"}),
        ("Closet", {"Storage"}),
    ],
)  # fmt: skip
def test_a_room_has_what_makes_it_that_room(kind: RoomType, expected: set[str]) -> None:
    for seed in range(6):
        assert expected <= set(types(furnished(kind, seed=seed)))


@pytest.mark.parametrize("kind", ROOM_TYPES)
@pytest.mark.parametrize("seed", range(3))
def test_a_robot_gets_around_in_a_full_room(kind: RoomType, seed: int) -> None:
    scene = furnished(kind, seed=seed, density=0.35)
    assert robot_gets_around(scene.floor, [piece.body for piece in scene.pieces], scene.entries, ROBOT_M)


def test_only_listed_types_stand_companions_included() -> None:
    assert set(types(furnished("Bedroom", ("Beds",)))) == {"Beds"}
    assert set(types(furnished("Bedroom", ("Nightstands", "Beds")))) == {"Beds", "Nightstands"}


def test_an_unknown_type_of_a_list_is_passed_over() -> None:
    assert set(types(furnished("Bedroom", ("Pianos", "Beds")))) == {"Beds"}


def test_an_empty_list_furnishes_nothing() -> None:
    assert types(furnished("Bedroom", ())) == []


def test_something_of_a_list_stands_however_sparse_the_room() -> None:
    assert types(furnished("Closet", ("Beds",), density=0.01)) == ["Beds"]


def test_a_list_of_small_things_is_repeated_within_reason() -> None:
    count = types(furnished("Living", ("FloorLamps",), density=0.3)).count("FloorLamps")
    assert 4 <= count <= 12


def test_primitives_stay_within_their_budget_give_or_take_a_group() -> None:
    for seed in range(6):
        scene = furnished("Dining", seed=seed, solids=60, density=0.6)
        groups = [sum(len(compose(p.type, p.size, LOOK.style)) for p in group.pieces) for group in scene.groups]
        assert sum(groups[:-1]) <= 60


@pytest.mark.parametrize("kind", ROOM_TYPES)
@pytest.mark.parametrize("density", [0.1, 0.2, 0.3])
def test_the_density_decides_how_much_floor_is_covered(kind: RoomType, density: float) -> None:
    # What lines the walls of closets and hallways ends before a third of the floor is covered.
    within = 0.09 if kind in ("Closet", "Hallway") and density > 0.25 else 0.05
    shares = [covered(furnished(kind, density=density, seed=seed)) for seed in range(5)]
    assert density - within < sum(shares) / len(shares) < density + 0.04


def test_a_hall_is_furnished_throughout() -> None:
    hall = Box(10.0, 10.0, 27.0, 27.0)
    scene = furnished("Bathroom", floor=hall, solids=450, density=0.2)
    names = types(scene)
    assert min(names.count(kind) for kind in ("Toilets", "VanityCounters", "Showers", "Baths")) >= 3
    middle = hall.grown(-3.0)
    assert any(piece.body.meets(middle) for piece in scene.pieces)


def test_a_large_robot_gets_wider_ways() -> None:
    for seed in range(4):
        scene = furnished("Living", seed=seed, density=0.3, radius_m=0.45)
        assert robot_gets_around(scene.floor, [piece.body for piece in scene.pieces], scene.entries, 0.45)
