"""The obstacles of a world as arrays, padded so that all worlds of a chunk have the same shapes."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from specs.data.world import Solid, World, solids

# Unused places are filled with specks far away and apart: nothing touches or sees them.
PARKING_M = 1000.0
_PARKING_STEP_M = 0.5
_SPECK_M = 0.05
# Counts are rounded up to these, times a power of two, so that few array shapes exist and adding worlds recompiles
# nothing.
_LEAST_BOXES = 128
_LEAST_CYLINDERS = 32


class Obstacles(NamedTuple):
    """Solids that cross a band of heights (metres).

    Attributes:
        boxes: Each (x, y, z, half x, half y, half z, cos yaw, sin yaw).
        cylinders: Each (x, y, z, radius, half z).
    """

    boxes: Float32[np.ndarray, "boxes 8"]
    cylinders: Float32[np.ndarray, "cylinders 5"]


def obstacles(world: World, low_m: float, high_m: float) -> Obstacles:
    """Returns the solids of a world that reach into the open band of heights, in document order."""
    crossing = [solid for solid in solids(world) if _crosses(solid, low_m, high_m)]
    boxes = [_box(solid) for solid in crossing if solid.shape == "box"]
    cylinders = [_cylinder(solid) for solid in crossing if solid.shape == "cylinder"]
    return Obstacles(np.asarray(boxes, np.float32).reshape(-1, 8), np.asarray(cylinders, np.float32).reshape(-1, 5))


def pad_obstacles(worlds: Iterable[Obstacles]) -> list[Obstacles]:
    """Returns the worlds' obstacles with parked specks added, so that all have the same, bucketed counts."""
    given = list(worlds)
    boxes = _bucket(max((len(each.boxes) for each in given), default=0), _LEAST_BOXES)
    cylinders = _bucket(max((len(each.cylinders) for each in given), default=0), _LEAST_CYLINDERS)
    return [
        Obstacles(
            np.concatenate([each.boxes, _parked_boxes(boxes)[len(each.boxes) :]]),
            np.concatenate([each.cylinders, _parked_cylinders(cylinders)[len(each.cylinders) :]]),
        )
        for each in given
    ]


def _crosses(solid: Solid, low_m: float, high_m: float) -> bool:
    z, half = solid.center_m[2], solid.half_extents_m[2]
    return z - half < high_m and z + half > low_m


def _box(solid: Solid) -> tuple[float, ...]:
    return (*solid.center_m, *solid.half_extents_m, float(np.cos(solid.yaw_rad)), float(np.sin(solid.yaw_rad)))


def _cylinder(solid: Solid) -> tuple[float, ...]:
    return (*solid.center_m, solid.half_extents_m[0], solid.half_extents_m[2])


def _bucket(count: int, least: int) -> int:
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
