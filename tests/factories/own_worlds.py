"""Worlds of one's own, drawn by hand: halls with pieces in them, in a frame of their own and without rooms."""

from collections.abc import Sequence

from specs.data.world import (
    Certificate,
    Furniture,
    ImportReport,
    OccupancyMap,
    Rectangle,
    Solid,
    Start,
    World,
    WorldSource,
)

GREY = (0.5, 0.5, 0.5)
WALL_M = 0.1
HEIGHT_M = 2.0
LOW_M = (10.0, 5.0)
"""The inner corner of each hall with the lowest x and y."""


def block(name: str, center_m: tuple[float, float], size_m: tuple[float, float], yaw_rad: float = 0.0) -> Solid:
    """Returns an upright box of 2 m height on the floor."""
    return Solid(
        name=name,
        shape="box",
        center_m=(*center_m, HEIGHT_M / 2),
        half_extents_m=(size_m[0] / 2, size_m[1] / 2, HEIGHT_M / 2),
        yaw_rad=yaw_rad,
        color=GREY,
    )


WEDGE = ((-0.5, -0.4), (0.5, -0.4), (0.3, 0.4), (-0.5, 0.2))
"""Corners of a prism whose centre is in the middle of the box around them."""


def wedge(name: str, center_m: tuple[float, float], yaw_rad: float = 0.0, low_m: float = 0.0) -> Solid:
    """Returns an upright prism of 1 m height, which no half turn maps to itself."""
    return Solid(
        name=name,
        shape="prism",
        center_m=(*center_m, low_m + 0.5),
        half_extents_m=(0.5, 0.4, 0.5),
        yaw_rad=yaw_rad,
        color=(0.2, 0.4, 0.6),
        outline_m=WEDGE,
    )


def piece(name: str, *solids: Solid) -> Furniture:
    """Returns a piece made of solids."""
    return Furniture(name=name, model_type=name, room="", center_m=solids[0].center_m[:2], yaw_rad=0.0, solids=solids)


def walled_hall(
    size_m: tuple[float, float] = (6.0, 4.0), pieces: Sequence[Furniture] = (), inner: Sequence[Solid] = ()
) -> World:
    """Returns a hall with walls around it; its map and its certificate are not measured.

    Args:
        size_m: Of its floor, whose lowest corner is at ``LOW_M``; the robot starts 1 m from it.
        pieces: What stands in it, where x and y are those of the hall's frame.
        inner: More walls.
    """
    (low_x, low_y), (width, depth) = LOW_M, size_m
    high_x, high_y = low_x + width, low_y + depth
    middle, across = (low_x + width / 2, low_y + depth / 2), WALL_M / 2
    walls = (
        block("south", (middle[0], low_y - across), (width + 2 * WALL_M, WALL_M)),
        block("north", (middle[0], high_y + across), (width + 2 * WALL_M, WALL_M)),
        block("west", (low_x - across, middle[1]), (WALL_M, depth)),
        block("east", (high_x + across, middle[1]), (WALL_M, depth)),
        *inner,
    )
    return World(
        version="2",
        generator="simyard-import-7",
        template_digest="",
        seed=0,
        generation="import-000000000000",
        name="hall",
        floorplan_index=0,
        interior_index=0,
        ceiling_height_m=HEIGHT_M,
        wall_thickness_m=WALL_M,
        footprint=Rectangle(
            x_min_m=low_x - WALL_M,
            y_min_m=low_y - WALL_M,
            x_max_m=low_x + width + WALL_M,
            y_max_m=low_y + depth + WALL_M,
        ),
        rooms=(),
        passages=(),
        walls=walls,
        furniture=tuple(pieces),
        lights=(),
        map=OccupancyMap(resolution_m=1.0, origin_m=LOW_M, columns=1, rows=1, runs=(1,)),
        certificate=Certificate(
            origin_clear_radius_m=0.0,
            guaranteed_robot_radius_m=0.0,
            reachable_robot_radius_m=0.0,
            doors_as_set_robot_radius_m=0.0,
            narrowest_passage_m=0.0,
            free_floor_share=0.0,
            area_error_mean=0.0,
            overlaps=0,
        ),
        start=Start(x_m=low_x + 1.0, y_m=low_y + 1.0),
        source=WorldSource(kind="sdf", file="hall.world", digest="0" * 64),
        report=ImportReport(parts=4, exact=4),
    )
