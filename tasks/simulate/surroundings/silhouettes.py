"""The outlines of a world in the lidar's plane, sorted by what a ray costs: upright boxes, turned boxes, circles."""

from collections.abc import Iterable
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Float32, Int, Int32

from tasks.simulate.surroundings.obstacles import PARKING_M, Obstacles

# A box counts as upright when its corners lie this near to those of the upright one: no ray can tell.
_UPRIGHT_M = 1e-6
# Unused places cost memory and no time, so one size fits nearly all worlds; beyond it sizes double.
_LEAST = (256, 64, 64)
_SPECK_M = 0.05


class Silhouettes(NamedTuple):
    """What a lidar can see of a world (metres).

    Attributes:
        upright: Boxes along the axes (x, y, half x, half y).
        turned: Other boxes (x, y, half x, half y, cos yaw, sin yaw).
        circles: (x, y, radius).
        counts: How many of each there are; what follows them is padding.
    """

    upright: Float[jax.Array, "upright 4"]
    turned: Float[jax.Array, "turned 6"]
    circles: Float[jax.Array, "circles 3"]
    counts: Int[jax.Array, "3"]


class HostSilhouettes(NamedTuple):
    """Silhouettes before they go to a device; fields as there."""

    upright: Float32[np.ndarray, "upright 4"]
    turned: Float32[np.ndarray, "turned 6"]
    circles: Float32[np.ndarray, "circles 3"]
    counts: Int32[np.ndarray, "3"]


def silhouettes(seen: Obstacles) -> HostSilhouettes:
    """Returns the outlines of the obstacles that cross the lidar's plane, without padding."""
    boxes = seen.boxes.astype(np.float64)
    half, turn = boxes[:, 3:5], boxes[:, 6:8]
    off = np.abs(turn).min(axis=1, initial=1.0) * half.max(axis=1, initial=0.0)
    upright = off <= _UPRIGHT_M
    across = np.abs(turn[:, 1]) > np.abs(turn[:, 0])
    half_along = np.where(across[:, None], half[:, ::-1], half)
    straight = np.hstack([boxes[:, :2], half_along])[upright]
    turned = np.hstack([boxes[:, :2], half, turn])[~upright]
    circles = seen.cylinders[:, [0, 1, 3]]
    counts = np.array([len(straight), len(turned), len(circles)], np.int32)
    return HostSilhouettes(straight.astype(np.float32), turned.astype(np.float32), circles.astype(np.float32), counts)


def pad_silhouettes(worlds: Iterable[HostSilhouettes]) -> list[HostSilhouettes]:
    """Returns the worlds' outlines with parked specks added, so that all have the same, bucketed sizes."""
    given = list(worlds)
    # By what the arrays hold, not by how many outlines there are: some may be filled up already.
    most = np.max([[len(array) for array in each[:3]] for each in given], axis=0) if given else np.zeros(3, np.int32)
    upright, turned, circles = (_bucket(int(count), least) for count, least in zip(most, _LEAST, strict=True))
    return [
        HostSilhouettes(
            _filled(each.upright, upright), _filled(each.turned, turned), _filled(each.circles, circles), each.counts
        )
        for each in given
    ]


def _bucket(count: int, least: int) -> int:
    size = least
    while size < count:
        size *= 2
    return size


def _filled(shapes: Float32[np.ndarray, "shapes columns"], size: int) -> Float32[np.ndarray, "size columns"]:
    parked = np.full((size, shapes.shape[1]), _SPECK_M, np.float32)
    parked[:, :2] = PARKING_M
    parked[:, 4:] = (1.0, 0.0)[: max(shapes.shape[1] - 4, 0)]
    parked[: len(shapes)] = shapes
    return parked
