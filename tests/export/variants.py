"""The apartment of tests/factories/worlds.py with what only some worlds have: a hinged door, windows."""

import math

from specs.data.world import Door, Solid, Window, World
from tests.factories.worlds import apartment

DOOR, HINGE_M = "door-1", (2.6, 0.06)
LEAF_LENGTH_M, LEAF_THICKNESS_M = 0.88, 0.04
WEST_WINDOW = Window(room="Living room", center_m=(-2.55, 0.0), width_m=1.2, along="y", bottom_m=0.9, top_m=2.1)
NORTH_WINDOW = Window(room="Kitchen", center_m=(4.6, 2.05), width_m=1.6, along="x", bottom_m=0.9, top_m=2.1)


def with_door(percent: float, world: World | None = None) -> World:
    """Returns the apartment with a door that opens into the kitchen, hinged at the doorway's southern jamb."""
    world = world or apartment()
    yaw_rad = math.pi / 2 - math.pi / 2 * percent / 100.0
    along, aside = (math.cos(yaw_rad), math.sin(yaw_rad)), (math.sin(yaw_rad), -math.cos(yaw_rad))
    x_m, y_m = (HINGE_M[axis] + along[axis] * LEAF_LENGTH_M / 2 + aside[axis] * LEAF_THICKNESS_M / 2 for axis in (0, 1))
    leaf = Solid(
        name=DOOR,
        shape="box",
        center_m=(x_m, y_m, 1.02),
        half_extents_m=(LEAF_LENGTH_M / 2, LEAF_THICKNESS_M / 2, 1.01),
        yaw_rad=yaw_rad,
        color=(0.9, 0.9, 0.9),
    )
    door = Door(
        name=DOOR,
        passage=0,
        opens_into=world.rooms[1].name,
        hinge_m=HINGE_M,
        closed_yaw_rad=math.pi / 2,
        open_yaw_rad=0.0,
        open_percent=percent,
        leaf=leaf,
    )
    return world.model_copy(update={"doors": (door,)})


def other_hand(door: Door) -> Door:
    """Returns a door that stands as this one does, as far open, and opens the other way round."""
    quarter_rad = door.closed_yaw_rad - door.open_yaw_rad
    shut_rad = door.leaf.yaw_rad - quarter_rad * door.open_percent / 100.0
    return door.model_copy(update={"closed_yaw_rad": shut_rad, "open_yaw_rad": shut_rad + quarter_rad})


def with_windows(world: World | None = None) -> World:
    """Returns the apartment with a window in either room."""
    world = world or apartment()
    living, kitchen = (room.name for room in world.rooms)
    windows = (
        WEST_WINDOW.model_copy(update={"room": living}),
        NORTH_WINDOW.model_copy(update={"room": kitchen}),
    )
    return world.model_copy(update={"windows": windows})
