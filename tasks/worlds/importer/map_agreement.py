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
from tasks.worlds.geometry import label_parts
from tasks.worlds.importer.mesh_sections import merged

_LIDARS_M = (0.13, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5)
"""Heights of lidars, first the most usual one: a map does not say how high its own was."""
_NEAR_M = 0.05
_TOUCHED = 0.75
"""Of a cell's side: a cell whose middle is as near to a solid is touched by it."""
_SAMPLE = 1_500


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


def agreement(solids: Sequence[Solid], known: FloorMap) -> MapAgreement:
    """Returns how solids agree with a map, cut at the height of a lidar at which they agree best.

    Of what the map has, the occupied cells beside free ones are compared: they are what a robot saw. Its floor are the
    free cells that hang together: what a lidar saw through a crack, or within walls, nobody drives on. Of these, a cell
    in a solid, and an occupied one that no solid touches, are floor of one side alone.

    Args:
        solids: Of a world, in the map's frame.
        known: The map.
    """
    seen = middles(known, known.occupied & ndimage.binary_dilation(known.free, structure=np.ones((3, 3))))
    some = seen[:: max(1, len(seen) // _SAMPLE)]
    shares = [_share_near(_away_m(cut_at(solids, height_m), some)) for height_m in _LIDARS_M]
    height_m = _LIDARS_M[int(np.argmax(shares))]
    world = cut_at(solids, height_m)
    shapely.prepare(world)
    away = _away_m(world, seen)
    floor = _largest_part(known.free)
    looked = floor | known.occupied
    from_solid = np.full(known.free.shape, np.inf)
    from_solid[looked] = shapely.distance(shapely.points(middles(known, looked)), world)
    both = floor & (from_solid > 0.0)
    either = floor | (known.occupied & (from_solid > _TOUCHED * known.resolution_m))
    return MapAgreement(
        map=known.name,
        height_m=height_m,
        within_5cm=round(_share_near(away), 4),
        mean_m=round(float(away.mean()), 4) if len(away) and np.isfinite(away).all() else 0.0,
        free_iou=round(float(both.sum() / max(int(either.sum()), 1)), 4),
    )


def cut_at(solids: Sequence[Solid], height_m: float) -> BaseGeometry:
    """Returns what solids fill at a height."""
    return merged([outline(each) for each in solids if abs(each.center_m[2] - height_m) <= each.half_extents_m[2]])


def _away_m(world: BaseGeometry, places: Float[np.ndarray, "places 2"]) -> Float[np.ndarray, "places"]:
    """Returns how far places are from the surfaces of a cut; without any, farther than all bounds."""
    surface = shapely.boundary(world)
    if surface.is_empty:
        return np.full(len(places), np.inf)
    return np.atleast_1d(shapely.distance(shapely.points(places), surface))


def _share_near(away_m: Float[np.ndarray, "places"]) -> float:
    return float((away_m <= _NEAR_M).mean()) if len(away_m) else 0.0


def _largest_part(free: Bool[np.ndarray, "rows columns"]) -> Bool[np.ndarray, "rows columns"]:
    labels = label_parts(free)
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return free & (labels == int(sizes.argmax()))


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
