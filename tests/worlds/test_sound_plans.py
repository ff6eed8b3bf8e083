"""A plan whose open doors would shut a wide robot out is drawn again."""

from tasks.worlds.floorplan.doors import hang_doors
from tasks.worlds.floorplan.floorplan import FloorPlan, build_walls, plan_floor
from tasks.worlds.generate import sound_plan
from tasks.worlds.geometry import measure_clearance, reaches_room
from tasks.worlds.resolved_template import ResolvedTemplate, resolve_template
from tests.worlds.templates import room, template

GREY = (0.5, 0.5, 0.5)
SEEDS = range(40)


def narrow(version: str) -> ResolvedTemplate:
    """Returns four small rooms for a robot that leaves hardly any room beside an open leaf."""
    kinds = ("Hallway", "Kitchen", "Bathroom", "Closet")
    return resolve_template(template(*(room(kind, kind, 10.0, (2.0, 1.0)) for kind in kinds), version=version), 0.58)


def passable(brief: ResolvedTemplate, plan: FloorPlan) -> bool:
    leaves = [way.leaf("leaf", 100.0, GREY) for way in hang_doors(brief, plan)]
    clearance = measure_clearance(plan.footprint, [*build_walls(plan, 3.0, [GREY] * 4), *leaves])
    reached = clearance.reached(brief.robot_radius_m)
    return all(reaches_room(reached, clearance, floor, brief.robot_radius_m) for floor in plan.floors)


def test_some_plans_are_not_passable_once_doors_hang() -> None:
    brief = narrow("2")
    assert not all(passable(brief, plan_floor(brief, seed, 1)) for seed in SEEDS)


def test_sound_plans_are_passable_with_their_doors_open() -> None:
    brief = narrow("2")
    assert all(passable(brief, sound_plan(brief, seed, 1)) for seed in SEEDS)


def test_a_plan_that_is_passable_at_once_is_kept() -> None:
    brief = narrow("2")
    sound = [seed for seed in SEEDS if passable(brief, plan_floor(brief, seed, 1))]
    assert all(sound_plan(brief, seed, 1) == plan_floor(brief, seed, 1) for seed in sound)


def test_without_doors_the_first_plan_is_taken() -> None:
    brief = narrow("1")
    assert all(sound_plan(brief, seed, 1) == plan_floor(brief, seed, 1) for seed in SEEDS)
