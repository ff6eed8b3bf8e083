"""How an imported world agrees with a map that a robot made of the same place.

A robot's map has its origin where the robot began. So one that agrees with nothing where it lies is looked for
elsewhere: turned by quarters and a little more, at all places at once by correlation, then by ever smaller steps.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
import shapely
from jaxtyping import Bool, Float
from scipy import ndimage
from shapely.geometry.base import BaseGeometry

from specs.data.world import MapAgreement, Solid, Start, corners_m
from tasks.worlds.geometry import label_parts
from tasks.worlds.importer.mesh_sections import merged

_LIDARS_M = (0.13, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5)
"""Heights of lidars, first the most usual one: a map does not say how high its own was."""
_NEAR_M = 0.05
_TOUCHED = 0.75
"""Of a cell's side: a cell whose middle is as near to a solid is touched by it."""
_SAMPLE = 1_500
# Where a map may lie instead: so far turned beside each quarter, on a grid of this size; then by steps of this size.
_TURNS_RAD = np.radians(np.arange(-3.0, 3.5, 1.0))
_COARSE_M, _FINE_M = 0.1, 0.02
_STEPS = ((0.04, 0.005), (0.02, 0.002), (0.01, 0.001))
_CUTS_M = (0.13, 0.25)
# Of grids of both sizes; a larger place is compared as it lies.
_MOST_COARSE, _MOST_FINE = 1 << 23, 1 << 25
_WEIGHT = 1000


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
    """Returns how solids agree with a map, where it lies, or where it would have to lie.

    Args:
        solids: Of a world.
        known: The map.
    """
    found = _compared(solids, known)
    if found.same_place:
        return found
    border = _border(known)
    beside = middles(known, known.free & ndimage.binary_dilation(known.occupied))
    moves = [_best_move(cut_at(solids, height_m), border, beside) for height_m in _CUTS_M] if len(border) else []
    if not any(moves):
        return found
    _, move = max(filter(None, moves), key=lambda each: each[0])
    (x, y), turn = _moved(move, np.array([known.origin[:2]]))[0], known.origin[2] + move.yaw_rad
    there = _compared(solids, known._replace(origin=(float(x), float(y), turn)))
    return there.model_copy(update={"moved": move}) if there.same_place else found


def _border(known: FloorMap) -> Float[np.ndarray, "cells 2"]:
    """Returns the occupied cells of a map beside free ones: what a robot saw."""
    return middles(known, known.occupied & ndimage.binary_dilation(known.free, structure=np.ones((3, 3))))


def _compared(solids: Sequence[Solid], known: FloorMap) -> MapAgreement:
    """Returns how solids agree with a map, cut at the height of a lidar at which they agree best.

    Of what the map has, the occupied cells beside free ones are compared: they are what a robot saw. Its floor are the
    free cells that hang together: what a lidar saw through a crack, or within walls, nobody drives on. Of these, a cell
    in a solid, and an occupied one that no solid touches, are floor of one side alone.

    Args:
        solids: Of a world, in the map's frame.
        known: The map.
    """
    seen = _border(known)
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


class _Surfaces(NamedTuple):
    """How far the middles of cells are from surfaces; (x, y) of the lowest one, and the side of all, in metres."""

    away_m: Float[np.ndarray, "columns rows"]
    low_m: Float[np.ndarray, "2"]
    cell_m: float

    @classmethod
    def of(cls, world: BaseGeometry, cell_m: float, most: int) -> Self | None:
        surface = shapely.segmentize(shapely.boundary(world), cell_m / 2)
        places = shapely.get_coordinates(surface)
        low_m = places.min(axis=0) - 2 * _COARSE_M
        size = np.ceil((places.max(axis=0) + 2 * _COARSE_M - low_m) / cell_m).astype(int) + 1
        if size.prod() > most:
            return None
        free = np.ones(size, bool)
        free[tuple(((places - low_m) / cell_m).astype(int).T)] = False
        return cls(np.asarray(ndimage.distance_transform_edt(free)) * cell_m, low_m, cell_m)

    def score(self, places: Float[np.ndarray, "places 2"]) -> int:
        """Returns how near places are to surfaces, more for nearer ones; a whole number, which no rounding changes."""
        at = np.floor((places - self.low_m) / self.cell_m).astype(int)
        inside = ((at >= 0) & (at < self.away_m.shape)).all(axis=1)
        away_m = self.away_m[tuple(at[inside].T)]
        return int(np.rint(_WEIGHT * np.exp(-((away_m / _NEAR_M) ** 2))).sum())


def _best_move(
    world: BaseGeometry, border: Float[np.ndarray, "cells 2"], beside: Float[np.ndarray, "floor 2"]
) -> tuple[int, Start] | None:
    """Returns how a map has to be moved to lie well in a cut, and how well that is; None where nothing can be said.

    Its border has to be near to surfaces, and the floor beside that not in solids: walls have two sides.
    """
    if world.is_empty:
        return None
    some, floor = (each[:: max(1, len(each) // _SAMPLE)] for each in (border, beside))
    coarse, fine = _Surfaces.of(world, _COARSE_M, _MOST_COARSE), _Surfaces.of(world, _FINE_M, _MOST_FINE)
    across = float(np.linalg.norm(np.ptp(some, axis=0))) / _COARSE_M + 2.0  # however it is turned
    if coarse is None or fine is None or math.prod(side + across for side in coarse.away_m.shape) > _MOST_COARSE:
        return None
    shapely.prepare(world)

    def score(move: Start) -> int:
        within = shapely.contains_xy(world, *_moved(move, floor).T)
        return fine.score(_moved(move, some)) - _WEIGHT * int(within.sum())

    turns = [quarter + turn for quarter in (0.0, math.pi / 2, math.pi, -math.pi / 2) for turn in _TURNS_RAD.tolist()]
    _, best = max((_best_shift(coarse, some, turn) for turn in turns), key=lambda each: each[0])
    most = score(best)
    for step_m, step_rad in _STEPS:
        while True:
            around = [
                Start(x_m=best.x_m + dx * step_m, y_m=best.y_m + dy * step_m, yaw_rad=best.yaw_rad + turn * step_rad)
                for dx, dy, turn in itertools.product((-1, 0, 1), repeat=3)
            ]
            scores = list(map(score, around))
            if max(scores) <= most:
                break
            most, best = max(scores), around[scores.index(max(scores))]
    return most, Start(x_m=round(best.x_m, 2), y_m=round(best.y_m, 2), yaw_rad=round(best.yaw_rad, 3))


def _best_shift(surfaces: _Surfaces, places: Float[np.ndarray, "places 2"], turn_rad: float) -> tuple[int, Start]:
    """Returns where turned places lie best on a grid, by how many of them are near to surfaces there."""
    cell_m = surfaces.cell_m
    turned = _moved(Start(x_m=0.0, y_m=0.0, yaw_rad=turn_rad), places)
    low = np.floor(turned.min(axis=0) / cell_m).astype(int)
    at = np.floor(turned / cell_m).astype(int) - low
    near = (surfaces.away_m <= cell_m).astype(float)
    size = tuple(a + b for a, b in zip(near.shape, at.max(axis=0) + 1, strict=True))
    counts = np.zeros(at.max(axis=0) + 1)
    np.add.at(counts, tuple(at.T), 1.0)
    # Of whole numbers: rounded, they are the same on any machine.
    transformed = np.fft.rfft2(near, size) * np.conj(np.fft.rfft2(counts, size))
    hits = np.rint(np.fft.irfft2(transformed, size)).astype(int)
    best = np.array(np.unravel_index(int(hits.argmax()), size))
    shift = np.where(best >= near.shape, best - size, best)
    x, y = (shift - low) * cell_m + surfaces.low_m
    return int(hits.max()), Start(x_m=float(x), y_m=float(y), yaw_rad=turn_rad)


def _moved(move: Start, places: Float[np.ndarray, "places 2"]) -> Float[np.ndarray, "places 2"]:
    """Returns places of a map as it lies once it is moved: turned about its frame's origin, then shifted."""
    cos, sin = math.cos(move.yaw_rad), math.sin(move.yaw_rad)
    return places @ np.array([[cos, sin], [-sin, cos]]) + [move.x_m, move.y_m]


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
