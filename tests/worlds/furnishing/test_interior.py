"""Whole interiors: whatever the room, nothing overlaps, blocks a door or leaves the floor, and a robot gets around."""

from collections import Counter
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from specs.data.world import Furniture, RoomType, Solid
from specs.template.interior import Density
from tasks.worlds.floorplan.floorplan import FloorPlan, plan_floor
from tasks.worlds.furnishing.furnish import Interior, InteriorKey, furnish_interior
from tasks.worlds.geometry import connected_share, reaches_room
from tasks.worlds.resolved_template import ResolvedTemplate, resolve_template
from tests.worlds.geometry_checks import distances, intersect, polygon
from tests.worlds.rooms import ROBOT_M, home, walls_of
from tests.worlds.templates import DENSITIES, MODEL_TYPES, ROOM_TYPES, furniture, room, template

_TOUCH_M = 1e-6
_START_M = 1.0
_BEFORE_DOOR_M = 0.8


@st.composite
def homes(draw: st.DrawFn) -> tuple[ResolvedTemplate, FloorPlan, InteriorKey, list[str] | None]:
    """Draws a room of any type, area, density and list, with a door and perhaps a window and the start."""
    listed = draw(st.none() | st.lists(st.sampled_from(MODEL_TYPES), max_size=8, unique=True))
    brief, plan = home(
        draw(st.sampled_from(ROOM_TYPES)),
        round(draw(st.floats(10.0, 60.0)), 1),
        draw(st.sampled_from(DENSITIES)),  # pyright: ignore[reportArgumentType] - names from the same Literal
        listed,
        aspect=draw(st.sampled_from((0.5, 1.0, 1.3, 2.0, 4.0))),
        radius_m=draw(st.sampled_from((0.15, ROBOT_M, 0.45))),
        start_inside=draw(st.booleans()),
        window=draw(st.booleans()),
    )
    return brief, plan, InteriorKey(draw(st.integers(0, 10_000)), 1, 1), listed


def interior(brief: ResolvedTemplate, plan: FloorPlan, draw: InteriorKey) -> Interior:
    return furnish_interior(brief, plan, walls_of(plan), draw)


@settings(max_examples=60)
@given(homes())
def test_pieces_stand_apart_on_the_floor_and_off_start_and_door(
    case: tuple[ResolvedTemplate, FloorPlan, InteriorKey, list[str] | None],
) -> None:
    brief, plan, draw, _ = case
    pieces = interior(brief, plan, draw).furniture
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
    brief, plan, draw, _ = case
    clearance = interior(brief, plan, draw).clearance
    reached = clearance.reached(brief.robot_radius_m)
    for floor in plan.floors:
        assert reaches_room(reached, clearance, floor, brief.robot_radius_m)
        assert connected_share(reached, clearance, floor, brief.robot_radius_m) >= 0.7


@settings(max_examples=60)
@given(homes())
def test_lists_are_obeyed(case: tuple[ResolvedTemplate, FloorPlan, InteriorKey, list[str] | None]) -> None:
    brief, plan, draw, listed = case
    pieces = interior(brief, plan, draw).furniture
    assert {piece.room for piece in pieces} <= {"Room"}
    if listed is not None:
        assert {piece.model_type for piece in pieces} <= set(listed)


@settings(max_examples=30)
@given(homes())
def test_the_same_stream_gives_the_same_interior(
    case: tuple[ResolvedTemplate, FloorPlan, InteriorKey, list[str] | None],
) -> None:
    brief, plan, draw, _ = case
    assert interior(brief, plan, draw).furniture == interior(brief, plan, draw).furniture


@pytest.mark.parametrize("kind", ROOM_TYPES)
@pytest.mark.parametrize("density", DENSITIES)
def test_a_listed_type_stands_where_there_is_room(kind: RoomType, density: Density) -> None:
    for model in MODEL_TYPES[::3]:
        brief, plan = home(kind, 20.0, density, [model], window=True)
        assert {piece.model_type for piece in interior(brief, plan, InteriorKey(1, 1, 1)).furniture} == {model}


def test_all_listed_types_appear_over_several_interiors() -> None:
    listed = list(MODEL_TYPES[:10])
    brief, plan = home("Living", 30.0, "Moderate", listed)
    found = {piece.model_type for n in range(1, 9) for piece in interior(brief, plan, InteriorKey(1, 1, n)).furniture}
    assert found == set(listed)


def test_interiors_of_a_plan_differ() -> None:
    brief, plan = home("Living", 25.0, "Moderate")
    first, second = (interior(brief, plan, InteriorKey(1, 1, n)).furniture for n in (1, 2))
    assert first != second


@pytest.mark.parametrize("density", DENSITIES)
def test_a_home_of_six_rooms_has_no_more_primitives_than_a_simulation_bears(density: Density) -> None:
    names = [f"Room {n}" for n in range(6)]
    rooms = [room(name, kind, 22.0) for name, kind in zip(names, ROOM_TYPES, strict=False)]
    brief = resolve_template(template(*rooms, arrangements=(furniture({"RoomNames": [*names]}, None, density),)))
    plan = plan_floor(brief, 3, 1)
    assert sum(len(piece.solids) for piece in interior(brief, plan, InteriorKey(3, 1, 1)).furniture) <= 480


def crowded() -> ResolvedTemplate:
    names = ["A", "B", "C"]
    arrangement = furniture({"RoomNames": [*names]}, list(MODEL_TYPES), "Dense")
    return resolve_template(template(*(room(name, area_m2=10.0) for name in names), arrangements=(arrangement,)))


def test_names_are_numbered_by_type_across_rooms() -> None:
    brief = crowded()
    plan = plan_floor(brief, 2, 1)
    pieces = interior(brief, plan, InteriorKey(2, 1, 1)).furniture
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
