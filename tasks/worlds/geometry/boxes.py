"""Axis-aligned boxes on the floor, and the tolerances that all of generation shares."""

from collections.abc import Iterable
from typing import NamedTuple

EPSILON_M = 1e-6
QUARTER_TURN_RAD = 1.5707963267948966


class Box(NamedTuple):
    """An axis-aligned rectangle on the floor, by its corners (metres)."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @property
    def width(self) -> float:
        """Extent along x (metres)."""
        return self.x_max - self.x_min

    @property
    def height(self) -> float:
        """Extent along y (metres)."""
        return self.y_max - self.y_min

    @property
    def area(self) -> float:
        """Area (square metres)."""
        return self.width * self.height

    @property
    def center(self) -> tuple[float, float]:
        """The middle (metres)."""
        return (self.x_min + self.x_max) / 2, (self.y_min + self.y_max) / 2

    def grown(self, by_m: float) -> "Box":
        """Returns the box with each side moved outwards (inwards when negative)."""
        return Box(self.x_min - by_m, self.y_min - by_m, self.x_max + by_m, self.y_max + by_m)

    def shifted(self, dx_m: float, dy_m: float) -> "Box":
        """Returns the box moved."""
        return Box(self.x_min + dx_m, self.y_min + dy_m, self.x_max + dx_m, self.y_max + dy_m)

    def meets(self, other: "Box") -> bool:
        """Returns whether the two share more than a border."""
        return (
            self.x_min < other.x_max - EPSILON_M
            and other.x_min < self.x_max - EPSILON_M
            and self.y_min < other.y_max - EPSILON_M
            and other.y_min < self.y_max - EPSILON_M
        )


def bounding_box(boxes: Iterable[Box]) -> Box:
    """Returns the smallest box that holds all of them."""
    low_x, low_y, high_x, high_y = zip(*boxes, strict=True)
    return Box(min(low_x), min(low_y), max(high_x), max(high_y))


def rounded(value: float, digits: int = 6) -> float:
    """Returns a number as a document holds it: rounded, and never a negative zero."""
    return round(float(value), digits) + 0.0
