"""Variants of a building of one's own: what changes, what stays, and what a robot keeps."""

import math
from dataclasses import replace

import numpy as np
import pytest

from specs.data.world import FloorZone, Furniture, Route, Solid, World, solids
from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.geometry import count_overlaps
from tasks.worlds.importer.own_floor import cell_at, own_floor, reached_from
from tasks.worlds.importer.variants import VariantWishes, vary_worlds
from tests.factories.own_worlds import block, piece, walled_hall

ALL = VariantWishes(move_m=0.4, remove=0.2, clutter=4, radius_m=0.2)


def vary_world(world: World, seed: int, number: int, wishes: VariantWishes) -> World:
    return next(vary_worlds(world, seed, [number], wishes))


def rack(number: int, x: float, y: float) -> Furniture:
    return piece(f"rack_{number}", block(f"rack_{number}", (x, y), (0.8, 0.4)))


RACKS = [rack(number, 12.0 + 1.5 * (number % 5), 7.0 + 1.5 * (number // 5)) for number in range(20)]
HALL = walled_hall((10.0, 8.0), RACKS)


def by_name(world: World) -> dict[str, Furniture]:
    return {piece.name: piece for piece in world.furniture}


def test_a_variant_hangs_on_world_seed_and_number_alone():
    assert vary_world(HALL, 3, 2, ALL) == vary_world(HALL, 3, 2, ALL)
    made = {vary_world(HALL, seed, number, ALL).furniture for seed in (3, 4) for number in (1, 2, 3)}
    assert len(made) == 6


@pytest.mark.parametrize("number", range(1, 9))
def test_a_variant_keeps_what_it_promises(number: int):
    made, before = vary_world(HALL, 1, number, ALL), own_floor(HALL)
    assert HALL.start is not None
    assert made.certificate.overlaps == count_overlaps(made.furniture, made.walls) == 0
    assert made.certificate.guaranteed_robot_radius_m == 0.2
    assert made.certificate.origin_clear_radius_m >= 0.2
    reached = reached_from(before, HALL.start, 0.2) & own_floor(made).free(0.2)
    still = reached_from(own_floor(made), HALL.start, 0.2)
    assert np.count_nonzero(still & reached) >= 0.9 * np.count_nonzero(reached)
    assert made.walls == HALL.walls
    assert len({solid.name for solid in solids(made)}) == len(solids(made))


def test_pieces_are_moved_no_farther_than_asked_for():
    made = by_name(vary_world(HALL, 5, 1, VariantWishes(move_m=0.3)))
    shifts = [math.dist(made[before.name].center_m, before.center_m) for before in HALL.furniture]
    assert 0.2 < max(shifts) <= 0.3 + 1e-6
    assert sum(shift > 0.0 for shift in shifts) > 15
    turns = [abs(made[before.name].yaw_rad) for before in HALL.furniture]
    assert 0.1 < max(turns) <= math.pi / 12 + 1e-6


def test_a_share_of_the_pieces_is_taken_out():
    left = [len(vary_world(HALL, 1, number, VariantWishes(remove=0.3)).furniture) for number in range(1, 21)]
    assert 0.6 < sum(left) / (20 * 20) < 0.8


def test_clutter_is_put_on_the_floor():
    made = vary_world(HALL, 1, 1, VariantWishes(clutter=5))
    added = [each for each in made.furniture if each.name.startswith("clutter")]
    assert {each.model_type for each in added} <= {"box", "pallet"}
    assert len(added) == 5
    assert all(min(part.center_m[2] - part.half_extents_m[2] for part in each.solids) == 0.0 for each in added)


def standing(name: str, low_m: float, *, size_m: tuple[float, float] = (0.3, 0.3)) -> Solid:
    solid = block(name, (13.0, 7.0), size_m)
    return solid.model_copy(
        update={"center_m": (13.0, 7.0, low_m + 0.2), "half_extents_m": (*solid.half_extents_m[:2], 0.2)}
    )


def test_what_goes_into_one_another_is_moved_together():
    pair = [piece("desk", standing("desk", 0.0, size_m=(1.0, 0.6))), piece("lamp", standing("lamp", 0.3))]
    made = by_name(vary_world(walled_hall((6.0, 4.0), pair), 2, 1, VariantWishes(move_m=0.5)))
    assert made["desk"].center_m == made["lamp"].center_m != (13.0, 7.0)
    assert made["desk"].yaw_rad == made["lamp"].yaw_rad


def test_what_hangs_is_long_or_holds_the_start_stays():
    still = [
        piece("lamp", standing("lamp", 1.2)),
        piece("counter", block("counter", (13.0, 8.0), (5.0, 0.3))),
        piece(
            "bay",
            block("left", (10.3, 6.0), (0.1, 1.4)),
            block("back", (11.0, 5.25), (1.4, 0.1)),
            block("right", (11.75, 6.0), (0.1, 1.4)),
        ),
    ]
    made = vary_world(walled_hall((6.0, 4.0), still), 2, 1, VariantWishes(move_m=0.5, remove=1.0))
    assert list(made.furniture) == still


def test_a_routes_places_stay_within_reach():
    hall = HALL.model_copy(update={"routes": (Route(name="tour", points_m=((19.0, 12.0), (11.0, 12.0))),)})
    made = vary_world(hall, 1, 1, replace(ALL, clutter=10))
    assert hall.start is not None
    assert hall.routes is not None
    grid = own_floor(made)
    cells = [cell_at(grid, place) for place in hall.routes[0].points_m]
    assert all(cell is not None and reached_from(grid, hall.start, 0.2)[cell] for cell in cells)


@pytest.mark.parametrize("number", [1, 11])
def test_a_zone_stays_within_reach(number: int):
    nook = FloorZone(name="nook", outline_m=((18.9, 11.9), (19.1, 11.9), (19.1, 12.1)), found=False)
    hall = HALL.model_copy(update={"zones": (nook,)})
    made = vary_world(hall, 1, number, replace(ALL, clutter=12))
    grid = own_floor(made)
    assert hall.start is not None
    columns, rows = np.nonzero(reached_from(grid, hall.start, 0.2))
    assert nook.holds(grid.centers_m[0][columns], grid.centers_m[1][rows]).any()


def test_a_world_that_a_robot_has_no_room_in_is_rejected():
    with pytest.raises(WorldRejected, match=r"a robot of 1 m radius has no room at the start"):
        vary_world(walled_hall((1.5, 1.5)), 1, 1, VariantWishes(radius_m=1.0))


def test_turned_prisms_are_moved_as_they_are():
    corners = ((-0.5, -0.5), (0.5, -0.5), (0.0, 0.5))
    wedge = block("wedge", (14.0, 7.0), (1.0, 1.0)).model_copy(update={"shape": "prism", "outline_m": corners})
    made = (
        vary_world(walled_hall((6.0, 4.0), [piece("wedge", wedge)]), 1, 1, VariantWishes(move_m=0.5))
        .furniture[0]
        .solids[0]
    )
    assert (made.outline_m, made.shape) == (corners, "prism")
    assert made.yaw_rad != 0.0
