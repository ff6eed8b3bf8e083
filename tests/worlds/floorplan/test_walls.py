"""Walls fill what is neither floor nor passage, once."""

from itertools import combinations

import pytest

from tasks.worlds.floorplan.floorplan import FloorPlan, build_walls, plan_floor
from tasks.worlds.resolved_template import resolve_template
from tests.worlds.geometry_checks import bottom_m, intersect
from tests.worlds.templates import connection, room, template

ROOMS = ("Living", "Kitchen", "Bedroom", "Bath", "Hall")
GREY = (0.5, 0.5, 0.5)


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
