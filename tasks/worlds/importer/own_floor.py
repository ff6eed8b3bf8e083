"""The floor of a world of one's own, measured: the map, and how large a robot gets about on it from the start."""

import math
from collections.abc import Collection

import numpy as np
from jaxtyping import Bool

from specs.data.world import Certificate, Start, World, solids, start_pose
from specs.template.body import TemplateBody
from tasks.worlds.certificate import SHRUNK, keep_furniture
from tasks.worlds.geometry import (
    CELL_M,
    RADIUS_MAX_M,
    Box,
    connected,
    count_overlaps,
    rounded,
)
from tasks.worlds.survey import ExactGrid, exact_grid

MOST_SHARE = 0.95
"""A robot that gets to so much of the floor that is wide enough for it gets about."""
_LEAST_RADIUS_M = 0.01
_RADII_M = [number / 100 for number in range(1, round(RADIUS_MAX_M * 100) + 1)]


def own_floor(world: World) -> ExactGrid:
    """Returns the floor within a world's footprint, with all that stands on it."""
    outer = world.footprint
    return exact_grid(Box(outer.x_min_m, outer.y_min_m, outer.x_max_m, outer.y_max_m), solids(world))


def cell_at(grid: ExactGrid, place_m: tuple[float, float]) -> tuple[int, int] | None:
    """Returns the cell that holds a place; None beside the floor."""
    x, y = (math.floor((at - low) / CELL_M) for at, low in zip(place_m, grid.origin, strict=True))
    return (x, y) if 0 <= x < grid.shape[0] and 0 <= y < grid.shape[1] else None


def reached_from(grid: ExactGrid, start: Start, radius_m: float) -> Bool[np.ndarray, "x y"]:
    """Returns the cells that a robot of that radius, at most 1 m, gets to from a start."""
    cell = cell_at(grid, (start.x_m, start.y_m))
    return connected(grid.free(radius_m), cell) if cell else np.zeros(grid.shape, bool)


def largest_radius_m(grid: ExactGrid, start: Start) -> float:
    """Returns the largest radius, in whole centimetres up to 1 m, with which a robot gets about; 0 where none does.

    Of the floor that the smallest robot reaches, it gets to ``MOST_SHARE`` of what is wide enough for it: nothing that
    matters is behind a gap that is too narrow. A room that no such robot could stand in does not count against it.
    """
    floor = reached_from(grid, start, _LEAST_RADIUS_M)
    low, high = -1, len(_RADII_M)
    while high - low > 1:
        middle = (low + high) // 2
        reached = np.count_nonzero(reached_from(grid, start, _RADII_M[middle]))
        wide = np.count_nonzero(grid.free(_RADII_M[middle]) & floor)
        low, high = (middle, high) if reached and reached >= MOST_SHARE * wide else (low, middle)
    return _RADII_M[low] if low >= 0 else 0.0


def measured(world: World, guaranteed_robot_radius_m: float = 0.0, floor: ExactGrid | None = None) -> World:
    """Returns a world of one's own with its map and its certificate, whatever these were.

    A certificate has no wishes, which nobody had. Its figures are those of the whole floor: there may be no rooms.

    Args:
        world: Imported, and maybe changed.
        guaranteed_robot_radius_m: Radius of the robot that the world was made passable for; 0 for none.
        floor: Of this world, where somebody has measured it.
    """
    grid, start = floor or own_floor(world), start_pose(world)
    radius_m = rounded(largest_radius_m(grid, start))
    cell = cell_at(grid, (start.x_m, start.y_m))
    certificate = Certificate(
        origin_clear_radius_m=rounded(0.0 if cell is None else float(grid.distance_m[cell])),
        guaranteed_robot_radius_m=rounded(guaranteed_robot_radius_m),
        reachable_robot_radius_m=radius_m,
        doors_as_set_robot_radius_m=radius_m,
        narrowest_passage_m=0.0,
        free_floor_share=rounded(1.0 - float(np.count_nonzero(grid.covered)) / grid.covered.size),
        area_error_mean=0.0,
        overlaps=count_overlaps(world.furniture, world.walls),
    )
    return world.model_copy(update={"map": grid.occupancy(), "certificate": certificate})


def keep_pieces(world: World, kept: Collection[str], template: TemplateBody | None = None) -> World:
    """Returns any world with some of its pieces, its map and its certificate measured anew.

    Args:
        world: Generated, or imported: then its certificate has no wishes to weigh.
        kept: Names of the pieces to keep.
        template: What a generated world was made from; None where that is not known.
    """
    if world.source is None:
        return keep_furniture(world, kept, template)
    generator = world.generator if world.generator.endswith(SHRUNK) else f"{world.generator}-{SHRUNK}"
    furniture = tuple(piece for piece in world.furniture if piece.name in kept)
    fewer = world.model_copy(update={"generator": generator, "furniture": furniture})
    return measured(fewer, world.certificate.guaranteed_robot_radius_m)
