"""Rooms are furnished to the density that is wished for, and a robot gets into each of them."""

from collections import Counter
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from specs.data.world import Furniture, RoomType, Solid
from specs.template.interior import Density
from tasks.worlds.floorplan.floorplan import FloorPlan, plan_floor
from tasks.worlds.furnishing.furnish import InteriorKey, furnish, furnish_interior
from tasks.worlds.furnishing.placement import robot_gets_around
from tasks.worlds.furnishing.scene import RoomScene, open_scene
from tasks.worlds.furniture.catalogue import compose
from tasks.worlds.geometry import Box, bounds_grid, connected_share, reaches_room
from tasks.worlds.resolved_template import (
    COVERED,
    COVERED_BY_TYPE,
    COVERED_SPREAD,
    FREE_FLOOR,
    ResolvedTemplate,
    RoomWish,
    resolve_template,
)
from tasks.worlds.survey import exact_grid
from tests.worlds.geometry_checks import distances, intersect, polygon
from tests.worlds.rooms import LOOK, ROBOT_M, home, walls_of
from tests.worlds.templates import DENSITIES, MODEL_TYPES, ROOM_TYPES, furniture, room, template

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


_TOUCH_M = 1e-6
_START_M = 1.0
_BEFORE_DOOR_M = 0.8


@st.composite
def homes(draw: st.DrawFn) -> tuple[ResolvedTemplate, FloorPlan, InteriorKey, list[str] | None]:
    """Draws a room of any type, area, density and list, with a door and perhaps a window and the start."""
    listed = draw(st.none() | st.lists(st.sampled_from(MODEL_TYPES), max_size=8, unique=True))
    resolved, plan = home(
        draw(st.sampled_from(ROOM_TYPES)),
        round(draw(st.floats(10.0, 60.0)), 1),
        draw(st.sampled_from(DENSITIES)),  # pyright: ignore[reportArgumentType] - names from the same Literal
        listed,
        aspect=draw(st.sampled_from((0.5, 1.0, 1.3, 2.0, 4.0))),
        radius_m=draw(st.sampled_from((0.15, ROBOT_M, 0.45))),
        start_inside=draw(st.booleans()),
        window=draw(st.booleans()),
    )
    return resolved, plan, InteriorKey(draw(st.integers(0, 10_000)), 1, 1), listed


def interior(resolved: ResolvedTemplate, plan: FloorPlan, draw: InteriorKey) -> tuple[Furniture, ...]:
    return furnish_interior(resolved, plan, walls_of(plan), draw)


@settings(max_examples=60)
@given(homes())
def test_pieces_stand_apart_on_the_floor_and_off_start_and_door(
    case: tuple[ResolvedTemplate, FloorPlan, InteriorKey, list[str] | None],
) -> None:
    resolved, plan, draw, _ = case
    pieces = interior(resolved, plan, draw)
    assert overlapping(pieces) == []
    solids = [solid for piece in pieces for solid in piece.solids]
    assert [solid.name for solid in solids if leaves_floor(solid, plan)] == []
    assert [solid.name for solid in solids if distances(solid, np.zeros((1, 2)))[0] < _START_M] == []
    assert [solid.name for solid in solids if before_door(solid, plan)] == []


@settings(max_examples=60)
@given(homes())
def test_a_robot_reaches_nearly_all_of_every_room(
    case: tuple[ResolvedTemplate, FloorPlan, InteriorKey, list[str] | None],
) -> None:
    resolved, plan, draw, _ = case
    solids = [*walls_of(plan), *(solid for piece in interior(resolved, plan, draw) for solid in piece.solids)]
    grid = bounds_grid(plan.footprint, solids)
    reached = grid.reached(resolved.robot_radius_m)
    for floor in plan.floors:
        assert reaches_room(reached, grid, floor, resolved.robot_radius_m)
        assert connected_share(reached, grid, floor, resolved.robot_radius_m) >= 0.7


@settings(max_examples=60)
@given(homes())
def test_lists_are_obeyed(case: tuple[ResolvedTemplate, FloorPlan, InteriorKey, list[str] | None]) -> None:
    resolved, plan, draw, listed = case
    pieces = interior(resolved, plan, draw)
    assert {piece.room for piece in pieces} <= {"Room"}
    if listed is not None:
        assert {piece.model_type for piece in pieces} <= set(listed)


@settings(max_examples=30)
@given(homes())
def test_the_same_stream_gives_the_same_interior(
    case: tuple[ResolvedTemplate, FloorPlan, InteriorKey, list[str] | None],
) -> None:
    resolved, plan, draw, _ = case
    assert interior(resolved, plan, draw) == interior(resolved, plan, draw)


@pytest.mark.parametrize("kind", ROOM_TYPES)
@pytest.mark.parametrize("density", DENSITIES)
def test_a_listed_type_stands_where_there_is_room(kind: RoomType, density: Density) -> None:
    for model in MODEL_TYPES[::3]:
        resolved, plan = home(kind, 20.0, density, [model], window=True)
        assert {piece.model_type for piece in interior(resolved, plan, InteriorKey(1, 1, 1))} == {model}


def test_all_listed_types_appear_over_several_interiors() -> None:
    listed = list(MODEL_TYPES[:10])
    resolved, plan = home("Living", 30.0, "Moderate", listed)
    found = {piece.model_type for n in range(1, 9) for piece in interior(resolved, plan, InteriorKey(1, 1, n))}
    assert found == set(listed)


def test_interiors_of_a_plan_differ() -> None:
    resolved, plan = home("Living", 25.0, "Moderate")
    first, second = (interior(resolved, plan, InteriorKey(1, 1, n)) for n in (1, 2))
    assert first != second


@pytest.mark.parametrize("density", DENSITIES)
def test_a_home_of_six_rooms_has_no_more_primitives_than_a_simulation_bears(density: Density) -> None:
    names = [f"Room {n}" for n in range(6)]
    rooms = [room(name, kind, 22.0) for name, kind in zip(names, ROOM_TYPES, strict=False)]
    resolved = resolve_template(template(*rooms, arrangements=(furniture({"RoomNames": [*names]}, None, density),)))
    plan = plan_floor(resolved, 3, 1)
    assert sum(len(piece.solids) for piece in interior(resolved, plan, InteriorKey(3, 1, 1))) <= 480


def crowded() -> ResolvedTemplate:
    names = ["A", "B", "C"]
    arrangement = furniture({"RoomNames": [*names]}, list(MODEL_TYPES), "Dense")
    return resolve_template(template(*(room(name, area_m2=10.0) for name in names), arrangements=(arrangement,)))


def test_names_are_numbered_by_type_across_rooms() -> None:
    resolved = crowded()
    plan = plan_floor(resolved, 2, 1)
    pieces = interior(resolved, plan, InteriorKey(2, 1, 1))
    assert len({piece.name for piece in pieces}) == len(pieces)
    assert all(piece.name.rsplit("_", 1)[0] == piece.model_type for piece in pieces)
    counts = Counter(piece.model_type for piece in pieces)
    assert {piece.name for piece in pieces} == {f"{kind}_{n + 1}" for kind in counts for n in range(counts[kind])}
    solids = [solid.name for piece in pieces for solid in piece.solids]
    assert len(set(solids)) == len(solids)


def overlapping(pieces: tuple[Furniture, ...]) -> list[tuple[str, str]]:
    return [
        (a.name, b.name)
        for a, b in combinations(pieces, 2)
        if any(intersect(x, y) for x in a.solids for y in b.solids if near(x, y))
    ]


def near(a: Solid, b: Solid) -> bool:
    reach = np.hypot(*a.half_extents_m[:2]) + np.hypot(*b.half_extents_m[:2])
    return bool(np.hypot(a.center_m[0] - b.center_m[0], a.center_m[1] - b.center_m[1]) < reach)


def leaves_floor(solid: Solid, plan: FloorPlan) -> bool:
    floor, corners = plan.floors[0].grown(_TOUCH_M), polygon(solid)
    inside = (corners >= np.array(floor[:2])) & (corners <= np.array(floor[2:]))
    return not inside.all()


def before_door(solid: Solid, plan: FloorPlan) -> bool:
    low, high = polygon(solid).min(axis=0), polygon(solid).max(axis=0)
    boxes = [gap.box(_BEFORE_DOOR_M) for gap in plan.gaps]
    return any(
        (low < np.array(box[2:]) - _TOUCH_M).all() and (high > np.array(box[:2]) + _TOUCH_M).all() for box in boxes
    )


ORDER: tuple[Density, ...] = ("Sparse", "Moderate", "Dense")
SEEDS = range(1, 5)
AREAS_M2 = (14.0, 30.0)


def free_floor(kind: RoomType, density: Density) -> list[float]:
    found: list[float] = []
    for area in AREAS_M2:
        resolved, plan = home(kind, area, density)
        for seed in SEEDS:
            furniture = furnish_interior(resolved, plan, walls_of(plan), InteriorKey(seed, 1, 1))
            grid = exact_grid(plan.footprint, [solid for piece in furniture for solid in piece.solids])
            found.append(1.0 - float(grid.covered[grid.cells(plan.floors[0])].mean()))
    return found


@pytest.mark.parametrize("kind", ROOM_TYPES)
def test_what_is_aimed_at_counts_as_met(kind: RoomType) -> None:
    for density in ORDER:
        least, most = FREE_FLOOR[density]
        free = 1.0 - COVERED_BY_TYPE.get(kind, COVERED)[density]
        assert least < free - COVERED_SPREAD
        assert free + COVERED_SPREAD < most


def test_the_bands_follow_each_other() -> None:
    for fuller, emptier in pairwise(FREE_FLOOR[density] for density in reversed(ORDER)):
        assert fuller[0] < emptier[0]
        assert fuller[1] < emptier[1]
        assert fuller[1] - emptier[0] <= 0.06 + 1e-9


@pytest.mark.parametrize("kind", ROOM_TYPES)
def test_rooms_of_each_type_tell_the_densities_apart(kind: RoomType) -> None:
    sparse, moderate, dense = (free_floor(kind, density) for density in ORDER)
    assert min(sparse) > max(moderate)
    assert sum(moderate) / len(moderate) > sum(dense) / len(dense) + 0.04
    met = [least <= free <= most for density, rooms in zip(ORDER, (sparse, moderate, dense), strict=True)
           for least, most in [FREE_FLOOR[density]] for free in rooms]  # fmt: skip
    assert sum(met) >= 0.9 * len(met)
