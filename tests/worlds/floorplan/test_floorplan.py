"""A floor plan is sound: cells, passages, windows and walls fit each other, and its start is at (0, 0)."""

from collections import Counter
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from specs.data.world import RoomType
from tasks.worlds.floorplan import floorplan
from tasks.worlds.floorplan.doors import hang_doors
from tasks.worlds.floorplan.floorplan import GLAZING_SHARE, FloorPlan, Pane, build_walls, place_windows, plan_floor
from tasks.worlds.floorplan.passages import shared_wall
from tasks.worlds.floorplan.scoring import WALL_M, doorway_width
from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.generate import sound_plan
from tasks.worlds.geometry import EPSILON_M, Box, bounds_grid, reaches_room
from tasks.worlds.resolved_template import ResolvedTemplate, resolve_template
from tests.worlds.geometry_checks import bottom_m, intersect
from tests.worlds.resolved_templates import flat, resolved, resolved_templates, wish
from tests.worlds.templates import SAMPLES, connection, room, sample, template

HABITABLE: tuple[RoomType, ...] = ("Bedroom", "Living", "Dining", "Kitchen")


def windows(kind: RoomType, *cells: Box) -> list[Pane]:
    """Returns the windows of the first of several rooms."""
    home = resolved(wish("It", kind), *(wish(f"Closet {n}", "Closet") for n in range(len(cells) - 1)))
    return [pane for pane in place_windows(home, cells) if pane.room == 0]


def glazing(panes: list[Pane]) -> float:
    return sum(pane.width * (pane.top - pane.bottom) for pane in panes)


@pytest.mark.parametrize("kind", HABITABLE)
@pytest.mark.parametrize("side", [3.0, 5.0, 9.0, 17.0])
def test_habitable_rooms_are_glazed_by_8_percent_of_their_floor(kind: RoomType, side: float) -> None:
    cell = Box(0, 0, side, side)
    panes = windows(kind, cell)
    assert GLAZING_SHARE * cell.grown(-0.06).area <= glazing(panes) < 0.12 * cell.area + 0.3
    assert max(pane.width for pane in panes) <= 2.0


@pytest.mark.parametrize(
    ("kind", "sill"), [("Bedroom", 0.9), ("Living", 0.9), ("Kitchen", 1.1), ("Bathroom", 1.5), ("Hallway", 0.9)]
)
def test_sills_are_above_a_lidar_above_worktops_and_in_bathrooms_above_eyes(kind: RoomType, sill: float) -> None:
    assert {(pane.bottom, pane.top) for pane in windows(kind, Box(0, 0, 4, 4))} == {(sill, 2.1)}


def test_a_bathroom_and_a_hallway_have_one_small_window() -> None:
    for kind in ("Bathroom", "Hallway"):
        (pane,) = windows(kind, Box(0, 0, 6, 6))
        assert pane.width == 0.6
        assert glazing([pane]) >= 0.3


def test_a_closet_has_no_window() -> None:
    assert windows("Closet", Box(0, 0, 4, 4)) == []


def test_a_room_without_an_outer_wall_has_no_window() -> None:
    around = [Box(0, 0, 6, 3), Box(6, 0, 9, 6), Box(3, 6, 9, 9), Box(0, 3, 3, 9)]
    assert windows("Bedroom", Box(3, 3, 6, 6), *around) == []


def test_walls_that_are_too_short_get_as_much_glass_as_they_hold() -> None:
    # Eight percent would be 2.7 m2; the one outer wall is 1.5 m long.
    (pane,) = windows("Living", Box(0, 0, 1.5, 24), Box(-4, 0, 0, 24), Box(1.5, 0, 6, 24), Box(-4, -3, 6, 0))
    # Two walls and what is left standing beside the window take 0.72 m.
    assert (pane.center[1], pane.width) == (24, 0.7)


def test_windows_keep_clear_of_corners_and_of_each_other() -> None:
    panes = windows("Living", Box(0, 0, 10, 8))
    spans = sorted((pane.center[0] - pane.width / 2, pane.center[0] + pane.width / 2) for pane in panes)
    assert len(spans) > 1
    assert spans[0][0] >= 0.06 + 0.3 - 1e-9
    assert spans[-1][1] <= 10 - 0.06 - 0.3 + 1e-9
    assert all(right[0] - left[1] >= 0.3 - 1e-9 for left, right in pairwise(spans))


def test_windows_of_a_plan_lie_in_the_outer_wall_of_their_room() -> None:
    for seed in range(10):
        plan = plan_floor(flat(), seed, 1)
        outline = plan.footprint.grown(-0.06)
        assert {pane.room for pane in plan.windows} >= {1, 2, 3, 4}
        for pane in plan.windows:
            axis = 0 if pane.along == "x" else 1
            across, floor = 1 - axis, plan.floors[pane.room]
            assert min(abs(pane.center[across] - outline[side]) for side in (across, across + 2)) < EPSILON_M
            assert abs(pane.center[across] - plan.cells[pane.room][across]) < EPSILON_M or (
                abs(pane.center[across] - plan.cells[pane.room][across + 2]) < EPSILON_M
            )
            assert pane.center[axis] - pane.width / 2 >= floor[axis] + 0.3 - 1e-6
            assert pane.center[axis] + pane.width / 2 <= floor[axis + 2] - 0.3 + 1e-6


def test_a_moved_window_keeps_its_size() -> None:
    pane = Pane(0, (2.0, 0.0), 1.2, "x", 0.9, 2.1)
    assert pane.shifted(-0.5, 1.25) == Pane(0, (1.5, 1.25), 1.2, "x", 0.9, 2.1)


GREY = (0.5, 0.5, 0.5)
seeds = st.integers(0, 2**32)
any_brief = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
HALL = wish("Hall", "Hallway", 10.0)
FOUR = tuple(wish(name, "Bedroom", 15.0) for name in "ABCD")
# Briefs at the edge of what a template may ask for.
EDGES = {
    "one room of 10 m2": resolved(wish("A", area_m2=10.0)),
    "one room of 10 m2, 4:1": resolved(wish("A", area_m2=10.0, aspect=4.0), footprint=4.0),
    "one room of 10 m2, 1:4": resolved(wish("A", area_m2=10.0, aspect=0.25), footprint=0.25),
    "six closets": resolved(*(wish(f"C{n}", "Closet", 10.0) for n in range(6))),
    "hall of 4:1": resolved(wish("H", "Hallway", 20.0, 4.0), *FOUR, connections=((0, 1), (0, 2), (0, 3), (0, 4))),
    "a hall and four rooms": resolved(HALL, *FOUR, connections=((0, 1), (0, 2), (0, 3), (0, 4))),
    "ring of four": resolved(*FOUR, connections=((0, 1), (1, 2), (2, 3), (0, 3))),
    "ring of five": resolved(HALL, *FOUR, connections=((0, 1), (1, 2), (2, 3), (3, 4), (0, 4))),
    "each with each of four": resolved(*FOUR, connections=tuple(combinations(range(4), 2))),
    "each with each of five": resolved(HALL, *FOUR, connections=tuple(combinations(range(5), 2))),
    "10 beside 300 m2": resolved(wish("Small", "Closet", 10.0), wish("Large", area_m2=300.0), connections=((0, 1),)),
    "bathroom of 300 m2": resolved(wish("Bath", "Bathroom", 300.0), wish("B", area_m2=20.0), wish("C", area_m2=15.0)),
    "robot of 0.45 m": resolved(*flat().rooms, connections=((0, 3), (0, 4), (0, 5)), openings=((0, 1),), radius_m=0.45),
    "robot of 0.6 m, doors": resolved(*flat().rooms, connections=((0, 3), (0, 4)), radius_m=0.6, doors=True),
    "twelve connections": resolved(
        *flat().rooms, connections=tuple(pair for pair in combinations(range(6), 2) if sum(pair) != 5)
    ),
    "several doorways": resolved(*FOUR, connections=((0, 1),) * 3 + ((2, 3),)),
    "opening between tiny rooms": resolved(wish("A", "Closet", 10.0), wish("B", "Closet", 10.0), openings=((0, 1),)),
}
# How many wished connections geometry allows of those that contradict each other: four rectangles that all touch each
# other make no rectangle.
POSSIBLE = {"each with each of four": 5, "each with each of five": 8, "twelve connections": 11}
every_edge = pytest.mark.parametrize("name", EDGES)


def covered(boxes: tuple[Box, ...]) -> float:
    return sum(box.area for box in boxes)


def met(home: ResolvedTemplate, plan: FloorPlan) -> int:
    """Returns how many wished connections a plan has."""
    built = Counter((gap.rooms, gap.kind) for gap in plan.gaps if gap.desired)
    wished = Counter((each.rooms, each.kind) for each in home.connections)
    return sum(min(built[key], count) for key, count in wished.items())


def reaches_all(home: ResolvedTemplate, plan: FloorPlan) -> bool:
    """Returns whether a robot gets into every room between the walls as built, on a grid."""
    grid = bounds_grid(plan.footprint, build_walls(plan, 2.7, [GREY] * len(home.rooms)))
    reached = grid.reached(home.robot_radius_m)
    return all(reaches_room(reached, grid, floor, home.robot_radius_m) for floor in plan.floors)


def has_clear_start(plan: FloorPlan) -> bool:
    return any(max(floor.x_min, floor.y_min, -floor.x_max, -floor.y_max) <= -1.0 for floor in plan.floors)


@any_brief
@given(resolved_templates(), seeds)
def test_cells_tile_the_footprint(home: ResolvedTemplate, seed: int) -> None:
    plan = plan_floor(home, seed, 1)
    assert not any(a.meets(b) for a, b in combinations(plan.cells, 2))
    assert covered(plan.cells) == pytest.approx(plan.footprint.grown(-WALL_M / 2).area)


@any_brief
@given(resolved_templates(), seeds)
def test_gaps_lie_in_the_wall_between_their_rooms_and_do_not_overlap(home: ResolvedTemplate, seed: int) -> None:
    plan = plan_floor(home, seed, 1)
    for gap in plan.gaps:
        wall = shared_wall(*(plan.cells[room] for room in gap.rooms))
        assert wall is not None
        along, across = gap.center if gap.along == "x" else gap.center[::-1]
        assert (gap.along, across) == (wall.along, pytest.approx(wall.at))
        assert along - gap.width / 2 >= wall.start + 0.09
        assert along + gap.width / 2 <= wall.end - 0.09
    assert not any(a.box(WALL_M / 2).meets(b.box(WALL_M / 2)) for a, b in combinations(plan.gaps, 2))


@any_brief
@given(resolved_templates(), seeds)
def test_inner_walls_lie_between_rooms_and_fill_what_is_neither_floor_nor_outer_wall(
    home: ResolvedTemplate, seed: int
) -> None:
    plan = plan_floor(home, seed, 1)
    outer = plan.footprint.area - plan.footprint.grown(-WALL_M).area
    inner = sum((cut.end - cut.start - WALL_M) * WALL_M for cut in plan.cuts)
    assert outer + inner + covered(plan.floors) == pytest.approx(plan.footprint.area)


@any_brief
@given(resolved_templates(), seeds)
def test_a_robot_reaches_every_room_of_a_bare_plan_from_a_clear_start(home: ResolvedTemplate, seed: int) -> None:
    plan = plan_floor(home, seed, 1)
    assert has_clear_start(plan)
    assert reaches_all(home, plan)
    assert min((gap.width for gap in plan.gaps), default=2.0) >= doorway_width(home)


@any_brief
@given(resolved_templates(), seeds)
def test_areas_are_within_3_percent(home: ResolvedTemplate, seed: int) -> None:
    plan = plan_floor(home, seed, 1)
    errors = [abs(floor.area / room.area_m2 - 1.0) for floor, room in zip(plan.floors, home.rooms, strict=True)]
    assert np.mean(errors) < 0.03
    assert max(errors) < 0.06


@every_edge
def test_a_plan_at_the_edge_is_a_home_with_all_connections_that_can_be(name: str) -> None:
    home = EDGES[name]
    for seed in range(5):
        plan = plan_floor(home, seed, 1)
        assert has_clear_start(plan)
        assert reaches_all(home, plan)
        assert met(home, plan) == POSSIBLE.get(name, len(home.connections))
        for floor, asked in zip(plan.floors, home.rooms, strict=True):
            assert floor.area == pytest.approx(asked.area_m2, rel=0.03)
            assert min(floor.width, floor.height) >= (1.2 if asked.type == "Hallway" else 1.5)


@pytest.mark.parametrize("path", SAMPLES, ids=lambda path: path.name.removesuffix(".body.json"))
def test_a_sample_gives_rooms_of_the_wished_shape_or_the_wished_footprint(path: str) -> None:
    home = resolve_template(sample(str(path).rsplit("/", 1)[-1].removesuffix(".body.json")))
    for seed in range(5):
        plan = plan_floor(home, seed, 1)
        ratios = [floor.width / floor.height / room.aspect for floor, room in zip(plan.floors, home.rooms, strict=True)]
        outline = plan.footprint.width / plan.footprint.height / home.footprint_aspect
        assert all(0.8 <= ratio <= 1.25 for ratio in ratios) or 0.8 <= outline <= 1.25


def test_floor_plans_of_one_job_differ() -> None:
    assert len({plan_floor(flat(), 1, index).cells for index in range(1, 21)}) == 20
    patterns = {
        tuple(a.x_max <= b.x_min + 1e-6 for a in plan.cells for b in plan.cells)
        for plan in (plan_floor(flat(), 1, index) for index in range(1, 21))
    }
    assert len(patterns) >= 8


def test_a_plan_is_the_same_in_another_order() -> None:
    plan_floor.cache_clear()
    first = [plan_floor(flat(), 5, index) for index in (1, 2)]
    plan_floor.cache_clear()
    assert [plan_floor(flat(), 5, index) for index in (2, 1)] == first[::-1]


def test_no_door_has_to_open_into_the_start_or_into_another_door() -> None:
    home = resolved(*flat().rooms, connections=((0, 3), (0, 4), (0, 5), (3, 5)), openings=((0, 1), (1, 2)), doors=True)
    for seed in range(20):
        hung = hang_doors(home, plan_floor(home, seed, 1))
        assert not any(way.swing.grown(-1e-6).meets(Box(-0.7, -0.7, 0.7, 0.7)) for way in hung)
        assert not any(a.swing.meets(b.swing) for a, b in combinations(hung, 2))


def test_a_plan_that_hinders_the_robot_is_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    plan_floor.cache_clear()
    first = plan_floor(flat(), 9, 1)
    plan_floor.cache_clear()
    refusals = iter(["Bath is too narrow", ""])
    monkeypatch.setattr(floorplan, "hindrance", lambda *_: next(refusals))
    assert plan_floor(flat(), 9, 1) != first
    plan_floor.cache_clear()


def test_a_brief_whose_plans_all_hinder_the_robot_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    plan_floor.cache_clear()
    monkeypatch.setattr(floorplan, "hindrance", lambda *_: "no way leads to Bath")
    with pytest.raises(WorldRejected, match="no way leads to Bath") as caught:
        plan_floor(flat(), 10, 1)
    assert caught.value.code == "InvalidInput"


SEEDS = range(40)


def narrow(version: str) -> ResolvedTemplate:
    """Returns four small rooms for a robot that leaves hardly any room beside an open leaf."""
    kinds = ("Hallway", "Kitchen", "Bathroom", "Closet")
    return resolve_template(template(*(room(kind, kind, 10.0, (2.0, 1.0)) for kind in kinds), version=version), 0.58)


def passable(resolved: ResolvedTemplate, plan: FloorPlan) -> bool:
    leaves = [way.leaf("leaf", 100.0, GREY) for way in hang_doors(resolved, plan)]
    grid = bounds_grid(plan.footprint, [*build_walls(plan, 3.0, [GREY] * 4), *leaves])
    reached = grid.reached(resolved.robot_radius_m)
    return all(reaches_room(reached, grid, floor, resolved.robot_radius_m) for floor in plan.floors)


def test_some_plans_are_not_passable_once_doors_hang() -> None:
    resolved = narrow("2")
    assert not all(passable(resolved, plan_floor(resolved, seed, 1)) for seed in SEEDS)


def test_sound_plans_are_passable_with_their_doors_open() -> None:
    resolved = narrow("2")
    assert all(passable(resolved, sound_plan(resolved, seed, 1)) for seed in SEEDS)


def test_a_plan_that_is_passable_at_once_is_kept() -> None:
    resolved = narrow("2")
    sound = [seed for seed in SEEDS if passable(resolved, plan_floor(resolved, seed, 1))]
    assert all(sound_plan(resolved, seed, 1) == plan_floor(resolved, seed, 1) for seed in sound)


def test_without_doors_the_first_plan_is_taken() -> None:
    resolved = narrow("1")
    assert all(sound_plan(resolved, seed, 1) == plan_floor(resolved, seed, 1) for seed in SEEDS)


ROOMS = ("Living", "Kitchen", "Bedroom", "Bath", "Hall")


def plan(seed: int) -> FloorPlan:
    wishes = (connection("Living", "Kitchen", "Opening"), connection("Hall", "Bath"))
    return plan_floor(resolve_template(template(*map(room, ROOMS), connections=wishes)), seed, 1)


@pytest.mark.parametrize("seed", range(4))
def test_walls_do_not_intersect_each_other(seed: int) -> None:
    walls = build_walls(plan(seed), 2.7, [GREY] * 5)
    assert [(a.name, b.name) for a, b in combinations(walls, 2) if intersect(a, b)] == []


@pytest.mark.parametrize("seed", range(4))
def test_walls_floors_and_gaps_make_up_the_footprint(seed: int) -> None:
    floor_plan = plan(seed)
    standing = [wall for wall in build_walls(floor_plan, 2.7, [GREY] * 5) if bottom_m(wall) == 0.0]
    walls = sum(4 * wall.half_extents_m[0] * wall.half_extents_m[1] for wall in standing)
    gaps = sum(gap.width * 0.12 for gap in floor_plan.gaps)
    floors = sum(floor.area for floor in floor_plan.floors)
    assert walls + gaps + floors == pytest.approx(floor_plan.footprint.area)


def test_an_opening_has_no_lintel_and_a_doorway_has_one() -> None:
    floor_plan = plan(0)
    lintels = [wall for wall in build_walls(floor_plan, 2.7, [GREY] * 5) if bottom_m(wall) > 0.0]
    assert len(lintels) == sum(gap.kind == "Doorway" for gap in floor_plan.gaps)


def test_outer_walls_have_the_colour_of_the_room_behind_them() -> None:
    colors = [(0.1 * n, 0.2, 0.3) for n in range(5)]
    outer = [wall for wall in build_walls(plan(1), 2.7, colors) if not wall.name.startswith(("wall_inner", "lintel"))]
    assert {wall.color for wall in outer} >= set(colors[:3]) or len({wall.color for wall in outer}) >= 3
