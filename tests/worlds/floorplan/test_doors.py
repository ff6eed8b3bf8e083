"""Leaves hang where they can swing, and stand as the template says."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import JsonValue

from specs.data.world import Solid, World
from tasks.worlds.floorplan.doors import LEAF_THICKNESS_M, hang_doors, open_leaves
from tasks.worlds.floorplan.floorplan import plan_floor
from tasks.worlds.generate import generate_world
from tasks.worlds.resolved_template import resolve_template
from tests.worlds.geometry_checks import intersecting
from tests.worlds.templates import doorway, room, template

ROOMS = (room("Hall", "Hallway", 14.0), room("Bed", "Bedroom", 16.0), room("Bath", "Bathroom", 10.0))


def made(percent: JsonValue, seed: int = 0) -> World:
    body = template(*ROOMS, version="2", doorways=(doorway("Target.All", percent),))
    return generate_world(body, seed=seed, generation="g", floorplan_index=1, interior_index=1)


def tip(leaf: Solid, hinge: tuple[float, float]) -> tuple[float, float]:
    """Returns the end of the leaf that is away from the hinge, on its centre line."""
    return 2 * leaf.center_m[0] - hinge[0], 2 * leaf.center_m[1] - hinge[1]


def test_doorways_of_version_1_stay_empty() -> None:
    body = template(*ROOMS)
    assert generate_world(body, seed=0, generation="g", floorplan_index=1, interior_index=1).doors == ()


@pytest.mark.parametrize("percent", [0.0, 35.0, 50.0, 100.0])
def test_every_doorway_has_a_leaf_at_the_wished_opening(percent: float) -> None:
    world = made(percent)
    assert [door.passage for door in world.doors] == list(range(len(world.passages)))
    for door in world.doors:
        quarter = math.remainder(door.open_yaw_rad - door.closed_yaw_rad, 2 * math.pi)
        assert abs(quarter) == pytest.approx(math.pi / 2)
        wanted = door.closed_yaw_rad + quarter * percent / 100
        found = math.atan2(*reversed([a - b for a, b in zip(tip(door.leaf, door.hinge_m), door.hinge_m, strict=True)]))
        # The leaf's centre line runs beside its hinge by half its thickness.
        assert abs(math.remainder(found - wanted, 2 * math.pi)) == pytest.approx(0.0, abs=0.06)
        assert door.open_percent == percent


def test_a_shut_leaf_fills_its_doorway_and_stays_in_the_wall() -> None:
    world = made(0.0)
    for door in world.doors:
        passage = world.passages[door.passage]
        along, across = (0, 1) if passage.along == "x" else (1, 0)
        assert 2 * door.leaf.half_extents_m[along] == pytest.approx(passage.width_m, abs=0.03)
        assert 2 * door.leaf.half_extents_m[across] == pytest.approx(LEAF_THICKNESS_M)
        offset = abs(door.leaf.center_m[across] - passage.center_m[across])
        assert offset + door.leaf.half_extents_m[across] <= world.wall_thickness_m / 2 + 1e-6


def test_a_shut_door_keeps_robots_out_and_the_certificate_says_so() -> None:
    certificate = made(0.0).certificate
    assert certificate.doors_as_set_robot_radius_m == 0.0
    assert certificate.reachable_robot_radius_m >= 0.25


def test_an_open_leaf_takes_its_thickness_from_the_passage() -> None:
    world = made(100.0)
    narrowest = min(passage.width_m for passage in world.passages)
    assert narrowest - 0.06 < world.certificate.narrowest_passage_m < narrowest - 0.03
    assert world.certificate.doors_as_set_robot_radius_m == world.certificate.reachable_robot_radius_m


def test_random_openings_differ_between_doors_and_worlds() -> None:
    found = {door.open_percent for seed in range(4) for door in made("Random", seed).doors}
    assert len(found) > 6
    assert all(0 <= percent <= 100 for percent in found)


def test_opened_leaves_are_those_of_a_world_whose_doors_are_open() -> None:
    shut, wide = made(0.0, 3), made(100.0, 3)
    assert [(each.center_m, each.half_extents_m) for each in open_leaves(shut.doors, shut.passages)] == [
        (door.leaf.center_m, door.leaf.half_extents_m) for door in wide.doors
    ]


@pytest.mark.long
@settings(max_examples=25)
@given(st.integers(0, 10_000), st.floats(0.0, 100.0))
def test_no_leaf_meets_a_wall_or_another_leaf_at_any_opening(seed: int, percent: float) -> None:
    assert intersecting(made(round(percent, 1), seed)) == []


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_no_leaf_sweeps_over_the_start(seed: int) -> None:
    resolved = resolve_template(template(*ROOMS, version="2"))
    for way in hang_doors(resolved, plan_floor(resolved, seed, 1)):
        assert min(math.hypot(*way.hinge), 9.0) - way.length >= 0.0 or _clear(way.swing)


def _clear(swing: tuple[float, float, float, float]) -> bool:
    x_min, y_min, x_max, y_max = swing
    return math.hypot(max(x_min, -x_max, 0.0), max(y_min, -y_max, 0.0)) >= 1.0
