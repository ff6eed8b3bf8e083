"""What is put together with a piece of each type stands where people put it, and none of it in the other."""

from itertools import combinations, pairwise, product

import numpy as np
import pytest

from specs.data.world import RoomType, Solid
from tasks.worlds.furnishing.arrangements import ROW, groups_to_try
from tasks.worlds.furnishing.assembly import assemble
from tasks.worlds.furnishing.groups import FurnitureGroup, RoomContext
from tasks.worlds.furnishing.placement import place_group, turn_quarters
from tasks.worlds.furnishing.scene import Piece
from tasks.worlds.furniture.catalogue import CATALOGUE
from tests.worlds.geometry_checks import intersect
from tests.worlds.rooms import LOOK, NOWHERE, empty_scene
from tests.worlds.templates import MODEL_TYPES, ROOM_TYPES

pytestmark = pytest.mark.long

SEEDS = range(4)


def groups(
    kind: str,
    room: RoomType = "Living",
    listed: tuple[str, ...] | None = None,
    *,
    seed: int = 1,
    size_m: tuple[float, float] = (6.0, 5.0),
) -> list[FurnitureGroup]:
    setting = RoomContext(np.random.default_rng(seed), room, empty_scene(*size_m), listed, 8.0)
    return list(groups_to_try(setting, kind))


def kinds(group: FurnitureGroup) -> list[str]:
    return [member.kind for member in group.members]


def solids(group: FurnitureGroup) -> list[list[Solid]]:
    return [
        list(
            assemble(
                Piece(member.kind, member.size, member.at, member.quarter, member.askew, NOWHERE), f"p{n}", "Room", LOOK
            ).solids
        )
        for n, member in enumerate(group.members)
    ]


@pytest.mark.parametrize("kind", MODEL_TYPES)
@pytest.mark.parametrize("room", ROOM_TYPES)
def test_every_type_has_an_arrangement_for_every_room(kind: str, room: RoomType) -> None:
    for listed in (None, (kind,)):
        found = groups(kind, room, listed)
        assert found
        assert any(kind in kinds(group) for group in found)
        assert all(CATALOGUE[member.kind].holds(member.size) for group in found for member in group.members)


@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_no_member_of_a_group_is_in_another(kind: str) -> None:
    for seed, room, size in product(SEEDS, ("Living", "Kitchen", "Bedroom"), ((3.5, 3.0), (8.0, 7.0))):
        for group in groups(kind, room, seed=seed, size_m=size):
            made = solids(group)
            for (a, first), (b, second) in combinations(enumerate(made), 2):
                assert not any(intersect(x, y) for x in first for y in second), (kinds(group)[a], kinds(group)[b])


@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_a_list_is_obeyed_in_every_group(kind: str) -> None:
    for room in ROOM_TYPES:
        assert {each for group in groups(kind, room, (kind,)) for each in kinds(group)} == {kind}


@pytest.mark.parametrize("kind", MODEL_TYPES)
def test_every_type_finds_a_place_in_an_empty_room(kind: str) -> None:
    scene = empty_scene(5.0, 4.0)
    setting = RoomContext(np.random.default_rng(1), "Living", scene, None, 8.0)
    assert any(place_group(np.random.default_rng(1), scene, group) for group in groups_to_try(setting, kind))


def test_nightstands_stand_at_both_sides_of_a_double_bed() -> None:
    bed, *others = groups("Beds", "Bedroom")[0].members
    stands = [member for member in others if member.kind == "Nightstands"]
    assert bed.size[0] > 1.3
    assert sorted(np.sign([stand.at[0] for stand in stands])) == [-1, 1]
    for stand in stands:
        assert stand.body.y_min == pytest.approx(bed.body.y_min)


def test_a_desk_chair_is_pushed_under_its_desk_and_faces_it() -> None:
    desk, chair = groups("Desks")[0].members
    assert (desk.kind, chair.kind) == ("Desks", "DeskChairs")
    assert desk.body.y_max - 0.3 < chair.body.y_min < desk.body.y_max
    assert chair.quarter == 2


@pytest.mark.parametrize("seed", range(10))
def test_diners_face_the_table_with_enough_room_for_each(seed: int) -> None:
    for group in groups("DiningTables", "Dining", seed=seed):
        table, *chairs = group.members
        assert 1 <= len(chairs) <= 6
        for chair in chairs:
            ahead = turn_quarters((0.0, 1.0), chair.quarter)
            inside = (chair.at[0] + 0.35 * ahead[0], chair.at[1] + 0.35 * ahead[1])
            body = table.body.grown(1e-6)
            assert body.x_min <= inside[0] <= body.x_max
            assert body.y_min <= inside[1] <= body.y_max
        for a, b in combinations(chairs, 2):
            if a.quarter == b.quarter:
                assert max(abs(a.at[0] - b.at[0]), abs(a.at[1] - b.at[1])) >= 0.55


def test_small_rooms_have_tables_for_four_at_most() -> None:
    for seed in range(10):
        assert all(len(group.members) <= 5 for group in groups("DiningTables", "Dining", seed=seed, size_m=(3.5, 3.5)))


@pytest.mark.parametrize("seed", range(10))
def test_a_sofa_faces_the_television_with_the_table_between(seed: int) -> None:
    group = groups("Sofas", seed=seed)[0]
    media, sofa = group.members[:2]
    assert (media.kind, sofa.kind) == ("MediaStorage", "Sofas")
    assert sofa.at[0] == media.at[0]
    assert sofa.quarter == 2
    assert 1.7 <= sofa.body.y_min - media.body.y_max <= 4.2
    table = next(member for member in group.members if member.kind == "CoffeeTables")
    assert media.body.y_max < table.body.y_min < table.body.y_max < sofa.body.y_min


@pytest.mark.parametrize("seed", range(10))
def test_armchairs_are_turned_to_the_table_before_the_sofa(seed: int) -> None:
    members = groups("Sofas", seed=seed)[0].members
    table = next(member for member in members if member.kind == "CoffeeTables")
    for chair in (member for member in members if member.kind == "LivingRoomChairs"):
        facing = chair.quarter * np.pi / 2 + chair.askew
        to_table = np.subtract(table.at, chair.at) / np.linalg.norm(np.subtract(table.at, chair.at))
        assert float(np.dot((-np.sin(facing), np.cos(facing)), to_table)) > 0.9


@pytest.mark.parametrize("seed", range(10))
def test_kitchen_units_make_one_row_under_one_worktop(seed: int) -> None:
    group = groups("Ovens", "Kitchen", seed=seed)[0]
    units = sorted((member for member in group.members if member.needed), key=lambda unit: unit.at[0])
    assert {"Fridges", "Ovens", "DishWashers"} <= set(kinds(group))
    for left, right in combinations(units, 2):
        assert left.body.y_min == pytest.approx(right.body.y_min)
    for left, right in pairwise(units):
        assert left.body.x_max == pytest.approx(right.body.x_min)
    assert "Fridges" in {units[0].kind, units[1].kind, units[-1].kind, units[-2].kind}


def test_an_island_leaves_an_aisle_before_the_row() -> None:
    found = [group for seed in range(10) for group in groups("Ovens", "Kitchen", seed=seed)]
    islands = [
        (group, member) for group in found for member in group.members if member.kind == "KitchenIslandsAndCarts"
    ]
    assert islands
    for group, island in islands:
        assert island.body.y_min - group.reach[0].y_max >= 1.0


def test_hallways_get_shallow_storage() -> None:
    assert all(group.members[0].size[1] <= 0.45 for group in groups("Storage", "Hallway", size_m=(6.0, 1.8)))


def test_bedrooms_get_wardrobes_first() -> None:
    assert all(groups("Storage", "Bedroom", seed=seed)[0].members[0].size[1] == 0.6 for seed in SEEDS)


def test_a_row_begins_with_its_tall_end() -> None:
    assert ROW == ("Fridges", "DishWashers", "Ovens", "WashingMachinesAndDryers")
