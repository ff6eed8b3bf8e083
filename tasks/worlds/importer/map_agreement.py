"""How an imported world agrees with a map that a robot made of the same place."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float
from scipy import ndimage
from shapely.geometry.base import BaseGeometry

from specs.data.world import MapAgreement, Solid, corners_m
from tasks.worlds.importer.mesh_sections import merged

LIDAR_M = 0.13
"""Height of the lidars of the robots that most maps were made with."""
_NEAR_M = 0.05
_TOUCHED = 0.75
"""Of a cell's side: a cell whose middle is as near to a solid is touched by it."""


class FloorMap(NamedTuple):
    """A map's cells, from the lowest y and x on.

    Attributes:
        name: Of its file.
        occupied: Which cells something stands in.
        free: Which cells are known to be free.
        resolution_m: Side of a cell.
        origin: Where the lower left corner is (x, y, in metres), and the turn of the rows (rad).
    """

    name: str
    occupied: Bool[np.ndarray, "rows columns"]
    free: Bool[np.ndarray, "rows columns"]
    resolution_m: float
    origin: tuple[float, float, float]


def agreement(solids: Sequence[Solid], known: FloorMap, height_m: float = LIDAR_M) -> MapAgreement:
    """Returns how solids agree with a map.

    Of what the map has, the occupied cells beside free ones are compared: they are what a robot saw. A free cell in a
    solid, and an occupied one that no solid touches, are floor of one side alone.

    Args:
        solids: Of a world, in the map's frame.
        known: The map.
        height_m: Where the world is cut: the height of the lidar that the map was made with.
    """
    world = merged([outline(each) for each in solids if abs(each.center_m[2] - height_m) <= each.half_extents_m[2]])
    shapely.prepare(world)
    seen = known.occupied & ndimage.binary_dilation(known.free, structure=np.ones((3, 3)))
    away = np.atleast_1d(shapely.distance(shapely.points(middles(known, seen)), shapely.boundary(world)))
    looked = known.free | known.occupied
    places = shapely.points(middles(known, looked))
    from_solid = np.full(known.free.shape, np.inf)
    from_solid[looked] = shapely.distance(places, world)
    both = known.free & (from_solid > 0.0)
    either = known.free | (looked & (from_solid > _TOUCHED * known.resolution_m))
    return MapAgreement(
        map=known.name,
        height_m=height_m,
        within_5cm=round(float((away <= _NEAR_M).mean()), 4) if len(away) else 0.0,
        mean_m=round(float(away.mean()), 4) if len(away) else 0.0,
        free_iou=round(float(both.sum() / max(int(either.sum()), 1)), 4),
    )


def middles(known: FloorMap, cells: Bool[np.ndarray, "rows columns"]) -> Float[np.ndarray, "cells 2"]:
    """Returns where the middles of some cells are."""
    row, column = np.nonzero(cells)
    across, up = (column + 0.5) * known.resolution_m, (row + 0.5) * known.resolution_m
    x, y, turn = known.origin
    cos, sin = math.cos(turn), math.sin(turn)
    return np.stack([x + cos * across - sin * up, y + sin * across + cos * up], axis=1)


def outline(solid: Solid) -> BaseGeometry:
    """Returns what a solid covers of the floor."""
    if solid.shape == "cylinder":
        return shapely.Point(solid.center_m[:2]).buffer(solid.half_extents_m[0], quad_segs=32)
    return shapely.Polygon(corners_m(solid))
