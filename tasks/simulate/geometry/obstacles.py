"""The obstacles of a world as arrays, padded so that all worlds of a chunk have the same shapes."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64, Int

from specs.data.world import MOST_CORNERS, Solid, World, corners_m, solids

# Unused places are filled with specks far away and apart: nothing touches or sees them.
PARKING_M = 1000.0
_PARKING_STEP_M = 0.5
_SPECK_M = 0.05
# Counts are rounded up to these, times a power of two, so that few array shapes exist and adding worlds recompiles
# nothing.
_LEAST_BOXES = 128
_LEAST_CYLINDERS = 32
# Where a world has any: most have none, and are not to be compiled or computed with places for them.
_LEAST_PRISMS = 32
PRISM_COLUMNS = 4 + 2 * MOST_CORNERS


class Obstacles(NamedTuple):
    """Solids that cross a band of heights (metres).

    Attributes:
        boxes: Each (x, y, z, half x, half y, half z, cos yaw, sin yaw).
        cylinders: Each (x, y, z, radius, half z).
        prisms: Each (x, y, z, half z, corners): eight (x, y) from its middle along the world's axes, counter-clockwise,
            the last one repeated where it has fewer.
    """

    boxes: Float32[np.ndarray, "boxes 8"]
    cylinders: Float32[np.ndarray, "cylinders 5"]
    prisms: Float32[np.ndarray, "prisms 20"]


def obstacles(world: World, low_m: float, high_m: float) -> Obstacles:
    """Returns the solids of a world that reach into the open band of heights, in document order."""
    crossing = [solid for solid in solids(world) if _crosses(solid, low_m, high_m)]
    boxes = [_box(solid) for solid in crossing if solid.shape == "box"]
    cylinders = [_cylinder(solid) for solid in crossing if solid.shape == "cylinder"]
    prisms = [_prism(solid) for solid in crossing if solid.shape == "prism"]
    return Obstacles(
        np.asarray(boxes, np.float32).reshape(-1, 8),
        np.asarray(cylinders, np.float32).reshape(-1, 5),
        np.asarray(prisms, np.float32).reshape(-1, PRISM_COLUMNS),
    )


def pad_obstacles(worlds: Iterable[Obstacles]) -> list[Obstacles]:
    """Returns the worlds' obstacles with parked specks added, so that all have the same, bucketed counts.

    There are no places for prisms if no world has one.
    """
    given = list(worlds)
    boxes, cylinders, prisms = (max((len(each[kind]) for each in given), default=0) for kind in range(3))
    parked = Obstacles(
        _parked_boxes(bucket_size(boxes, _LEAST_BOXES)),
        _parked_cylinders(bucket_size(cylinders, _LEAST_CYLINDERS)),
        _parked_prisms(bucket_size(prisms, _LEAST_PRISMS) if prisms else 0),
    )
    return [
        Obstacles(*(np.concatenate([own, specks[len(own) :]]) for own, specks in zip(each, parked, strict=True)))
        for each in given
    ]


def _crosses(solid: Solid, low_m: float, high_m: float) -> bool:
    z, half = solid.center_m[2], solid.half_extents_m[2]
    return z - half < high_m and z + half > low_m


def _box(solid: Solid) -> tuple[float, ...]:
    return (*solid.center_m, *solid.half_extents_m, float(np.cos(solid.yaw_rad)), float(np.sin(solid.yaw_rad)))


def _cylinder(solid: Solid) -> tuple[float, ...]:
    return (*solid.center_m, solid.half_extents_m[0], solid.half_extents_m[2])


def _prism(solid: Solid) -> tuple[float, ...]:
    corners = np.array(corners_m(solid)) - solid.center_m[:2]
    filled = np.concatenate([corners, np.repeat(corners[-1:], MOST_CORNERS - len(corners), axis=0)])
    return (*solid.center_m, solid.half_extents_m[2], *filled.ravel().tolist())


def half_planes(prisms: Float32[np.ndarray, "prisms 20"]) -> Float64[np.ndarray, "prisms planes 3"]:
    """Returns prisms as half-planes: each outward normal (x, y), and how far out from the middle its edge is.

    Those of its edges come first, beginning with the one that closes the outline; then one of them is repeated.
    """
    corners = prisms[:, 4:].astype(np.float64).reshape(-1, MOST_CORNERS, 2)
    along = np.roll(corners, -1, axis=1) - corners
    length = np.hypot(along[..., 0], along[..., 1])
    normals = np.stack([along[..., 1], -along[..., 0]], axis=-1) / np.where(length > 0.0, length, 1.0)[..., None]
    planes = np.concatenate([normals, np.sum(normals * corners, axis=-1, keepdims=True)], axis=-1)
    return np.roll(np.where(length[..., None] > 0.0, planes, planes[:, :1]), 1, axis=1)


def edge_counts(prisms: Float32[np.ndarray, "prisms 20"]) -> Int[np.ndarray, "prisms"]:
    """Returns how many edges each prism has."""
    corners = prisms[:, 4:].reshape(-1, MOST_CORNERS, 2)
    return (np.roll(corners, -1, axis=1) != corners).any(axis=2).sum(axis=1)


def bucket_size(count: int, least: int) -> int:
    """Returns the least size, doubled until it is no less than a count."""
    size = least
    while size < count:
        size *= 2
    return size


def _parked_boxes(count: int) -> Float32[np.ndarray, "boxes 8"]:
    boxes = np.full((count, 8), _SPECK_M, np.float32)
    boxes[:, 0] = PARKING_M + _PARKING_STEP_M * np.arange(count)
    boxes[:, 1] = PARKING_M
    boxes[:, 6:] = (1.0, 0.0)
    return boxes


def _parked_cylinders(count: int) -> Float32[np.ndarray, "cylinders 5"]:
    cylinders = np.full((count, 5), _SPECK_M, np.float32)
    cylinders[:, 0] = -PARKING_M - _PARKING_STEP_M * np.arange(count)
    cylinders[:, 1] = -PARKING_M
    return cylinders


def _parked_prisms(count: int) -> Float32[np.ndarray, "prisms 20"]:
    square = _SPECK_M * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    prisms = np.full((count, PRISM_COLUMNS), _SPECK_M, np.float32)
    prisms[:, 0] = PARKING_M + _PARKING_STEP_M * np.arange(count)
    prisms[:, 1] = -PARKING_M
    prisms[:, 4:] = np.concatenate([square, np.repeat(square[-1:], MOST_CORNERS - len(square), axis=0)]).ravel()
    return prisms


CELL_M = 0.1
_GRID_SIZES = (144, 192, 256, 384, 512)


def grid_cells(world: World) -> int:
    """Returns how many cells a side the world's grid has: one of five sizes, so that few array shapes exist."""
    return next((cells for cells in _GRID_SIZES if cells * CELL_M >= extent_m(world)), _GRID_SIZES[-1])


def extent_m(world: World) -> float:
    """Returns the longer side of a world, by its outer faces."""
    outer = world.footprint
    return max(outer.x_max_m - outer.x_min_m, outer.y_max_m - outer.y_min_m)
