"""Rooms of a floor that has none, beside those of worlds of which they are known."""

import pytest
import shapely

from specs.data.world import FloorZone, Rectangle, Start, World
from tasks.worlds.importer.floor_rooms import found_rooms
from tasks.worlds.importer.own_floor import own_floor
from tests.factories.own_worlds import block, walled_hall
from tests.factories.worlds import apartment

HOME = apartment()
HERE = Start(x_m=11.0, y_m=6.0)


def rooms(world: World, start: Start) -> tuple[FloorZone, ...]:
    return found_rooms(own_floor(world.model_copy(update={"furniture": (), "doors": ()})), start)


def test_rooms_are_what_doors_part():
    found = rooms(HOME, Start(x_m=0.0, y_m=0.0))
    outlines = [shapely.Polygon(zone.outline_m) for zone in found]
    shares: list[float] = []
    for room in HOME.rooms:
        floor = shapely.box(room.floor.x_min_m, room.floor.y_min_m, room.floor.x_max_m, room.floor.y_max_m)
        shares.append(max(floor.intersection(each).area / floor.union(each).area for each in outlines))
    assert len(found) == len(HOME.rooms)
    assert min(shares) > 0.9


def test_an_open_floor_has_none():
    assert rooms(walled_hall((6.0, 4.0)), HERE) == ()
    assert rooms(walled_hall((6.0, 4.0), inner=[block("counter", (13.0, 6.0), (0.2, 2.0))]), HERE) == ()


@pytest.mark.parametrize("start", [HERE, Start(x_m=-50.0, y_m=0.0)])
def test_what_leads_out_of_the_building_is_no_room(start: Start):
    world = walled_hall(
        (6.0, 4.0), inner=[block("low", (13.1, 6.0), (0.2, 2.0)), block("high", (13.1, 8.4), (0.2, 1.2))]
    )
    around = world.footprint
    wider = Rectangle(
        x_min_m=around.x_min_m - 3.0, y_min_m=around.y_min_m, x_max_m=around.x_max_m, y_max_m=around.y_max_m
    )
    open_to_it = tuple(wall for wall in world.walls if wall.name != "west")
    outside = world.model_copy(update={"footprint": wider, "walls": open_to_it})
    assert len(rooms(world, HERE)) == 2
    assert rooms(outside, start) == ()
