"""Layouts in bulk: where rooms stand, as lines that several of them share.

Axes: ``layouts`` last, so that arithmetic runs along memory; ``lines`` are the outline's four, then the inner walls'
centre lines (``tasks.worlds.floorplan.slicing`` names them). The lower left corner of the outline is the origin.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from tasks.worlds.geometry.boxes import EPSILON_M


@dataclass(frozen=True)
class Layouts:
    """Layouts of the same rooms.

    Attributes:
        sides: The lines at the lowest x, lowest y, highest x and highest y of each room.
        vertical: Whether a line runs along y.
        lines: Where a line lies: its x if it runs along y, else its y (metres).
    """

    sides: Int[np.ndarray, "rooms 4 layouts"]
    vertical: Bool[np.ndarray, "lines layouts"]
    lines: Float[np.ndarray, "lines layouts"]

    def __getitem__(self, chosen: Int[np.ndarray, " some"]) -> "Layouts":
        """Returns some of the layouts."""
        return Layouts(self.sides[..., chosen], self.vertical[:, chosen], self.lines[:, chosen])

    def moved(self, lines: Float[np.ndarray, "lines layouts"]) -> "Layouts":
        """Returns the same layouts with their lines elsewhere."""
        return replace(self, lines=lines)

    def cells(self) -> Float[np.ndarray, "4 rooms layouts"]:
        """Returns the rooms' cells: lowest x and y, highest x and y, between wall centre lines."""
        return np.take_along_axis(self.lines[None], self.sides.transpose(1, 0, 2), axis=1)


def join_layouts(many: list[Layouts]) -> Layouts:
    """Returns several bulks of layouts as one."""
    return Layouts(
        np.concatenate([each.sides for each in many], axis=-1),
        np.concatenate([each.vertical for each in many], axis=-1),
        np.concatenate([each.lines for each in many], axis=-1),
    )


def common_walls(
    cells: Float[np.ndarray, "4 rooms layouts"], first: Int[np.ndarray, " pairs"], second: Int[np.ndarray, " pairs"]
) -> Float[np.ndarray, "pairs layouts"]:
    """Returns how far two cells lie side by side, for pairs of rooms (metres); 0 for cells that do not touch."""
    a, b = cells[:, first], cells[:, second]
    along = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    touching = np.abs(along) < EPSILON_M
    return np.maximum(np.where(touching[0], along[1], np.where(touching[1], along[0], 0.0)), 0.0)
