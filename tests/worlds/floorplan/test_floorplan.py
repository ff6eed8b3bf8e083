"""A floor plan is a home that a robot gets about, as near to the brief as geometry allows."""

from collections import Counter
from itertools import combinations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tasks.worlds.floorplan import floorplan
from tasks.worlds.floorplan.doors import hang_doors
from tasks.worlds.floorplan.floorplan import FloorPlan, build_walls, plan_floor
from tasks.worlds.floorplan.passages import shared_wall
from tasks.worlds.floorplan.scoring import WALL_M, doorway_width
from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.geometry import Box, measure_clearance, reaches_room
from tasks.worlds.resolved_template import ResolvedTemplate, resolve_template
from tests.worlds.briefs import brief, briefs, flat, wish
from tests.worlds.templates import SAMPLES, sample

GREY = (0.5, 0.5, 0.5)
seeds = st.integers(0, 2**32)
any_brief = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
HALL = wish("Hall", "Hallway", 10.0)
FOUR = tuple(wish(name, "Bedroom", 15.0) for name in "ABCD")
# Briefs at the edge of what a template may ask for.
EDGES = {
    "one room of 10 m2": brief(wish("A", area_m2=10.0)),
    "one room of 10 m2, 4:1": brief(wish("A", area_m2=10.0, aspect=4.0), footprint=4.0),
    "one room of 10 m2, 1:4": brief(wish("A", area_m2=10.0, aspect=0.25), footprint=0.25),
    "six closets": brief(*(wish(f"C{n}", "Closet", 10.0) for n in range(6))),
    "hall of 4:1": brief(wish("H", "Hallway", 20.0, 4.0), *FOUR, connections=((0, 1), (0, 2), (0, 3), (0, 4))),
    "a hall and four rooms": brief(HALL, *FOUR, connections=((0, 1), (0, 2), (0, 3), (0, 4))),
    "ring of four": brief(*FOUR, connections=((0, 1), (1, 2), (2, 3), (0, 3))),
    "ring of five": brief(HALL, *FOUR, connections=((0, 1), (1, 2), (2, 3), (3, 4), (0, 4))),
    "each with each of four": brief(*FOUR, connections=tuple(combinations(range(4), 2))),
    "each with each of five": brief(HALL, *FOUR, connections=tuple(combinations(range(5), 2))),
    "10 beside 300 m2": brief(wish("Small", "Closet", 10.0), wish("Large", area_m2=300.0), connections=((0, 1),)),
    "bathroom of 300 m2": brief(wish("Bath", "Bathroom", 300.0), wish("B", area_m2=20.0), wish("C", area_m2=15.0)),
    "robot of 0.45 m": brief(*flat().rooms, connections=((0, 3), (0, 4), (0, 5)), openings=((0, 1),), radius_m=0.45),
    "robot of 0.6 m, doors": brief(*flat().rooms, connections=((0, 3), (0, 4)), radius_m=0.6, doors=True),
    "twelve connections": brief(
        *flat().rooms, connections=tuple(pair for pair in combinations(range(6), 2) if sum(pair) != 5)
    ),
    "several doorways": brief(*FOUR, connections=((0, 1),) * 3 + ((2, 3),)),
    "opening between tiny rooms": brief(wish("A", "Closet", 10.0), wish("B", "Closet", 10.0), openings=((0, 1),)),
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
    clearance = measure_clearance(plan.footprint, build_walls(plan, 2.7, [GREY] * len(home.rooms)))
    reached = clearance.reached(home.robot_radius_m)
    return all(reaches_room(reached, clearance, floor, home.robot_radius_m) for floor in plan.floors)


def has_clear_start(plan: FloorPlan) -> bool:
    return any(max(floor.x_min, floor.y_min, -floor.x_max, -floor.y_max) <= -1.0 for floor in plan.floors)


@any_brief
@given(briefs(), seeds)
def test_cells_tile_the_footprint(home: ResolvedTemplate, seed: int) -> None:
    plan = plan_floor(home, seed, 1)
    assert not any(a.meets(b) for a, b in combinations(plan.cells, 2))
    assert covered(plan.cells) == pytest.approx(plan.footprint.grown(-WALL_M / 2).area)


@any_brief
@given(briefs(), seeds)
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
@given(briefs(), seeds)
def test_inner_walls_lie_between_rooms_and_fill_what_is_neither_floor_nor_outer_wall(
    home: ResolvedTemplate, seed: int
) -> None:
    plan = plan_floor(home, seed, 1)
    outer = plan.footprint.area - plan.footprint.grown(-WALL_M).area
    inner = sum((cut.end - cut.start - WALL_M) * WALL_M for cut in plan.cuts)
    assert outer + inner + covered(plan.floors) == pytest.approx(plan.footprint.area)


@any_brief
@given(briefs(), seeds)
def test_a_robot_reaches_every_room_of_a_bare_plan_from_a_clear_start(home: ResolvedTemplate, seed: int) -> None:
    plan = plan_floor(home, seed, 1)
    assert has_clear_start(plan)
    assert reaches_all(home, plan)
    assert min((gap.width for gap in plan.gaps), default=2.0) >= doorway_width(home)


@any_brief
@given(briefs(), seeds)
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
        for floor, room in zip(plan.floors, home.rooms, strict=True):
            assert floor.area == pytest.approx(room.area_m2, rel=0.03)
            assert min(floor.width, floor.height) >= (1.2 if room.type == "Hallway" else 1.5)


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
    home = brief(*flat().rooms, connections=((0, 3), (0, 4), (0, 5), (3, 5)), openings=((0, 1), (1, 2)), doors=True)
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
