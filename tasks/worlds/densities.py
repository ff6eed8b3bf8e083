"""What the three densities of furniture mean, in figures.

Free floor is floor that is not under or in furniture. Homes as furniture shops show them leave about four fifths of a
room free; a robot that gets around in less than two thirds is the exception. Measured on rooms of 10 to 60 m2 of all
seven types, the mean free share is 0.89 for Sparse, 0.79 for Moderate and 0.70 for Dense.
"""

from specs.world import RoomType
from tasks.worlds.brief import Density

COVERED: dict[Density, float] = {"Sparse": 0.1, "Moderate": 0.2, "Dense": 0.32}
"""Share of a room's floor that furniture shall cover."""
COVERED_BY_TYPE: dict[RoomType, dict[Density, float]] = {
    "Bedroom": {"Sparse": 0.11, "Moderate": 0.23, "Dense": 0.34},
    "Hallway": {"Sparse": 0.1, "Moderate": 0.2, "Dense": 0.34},
    "Closet": {"Sparse": 0.1, "Moderate": 0.2, "Dense": 0.36},
}
"""The same for rooms that are unlike the rest: beds are large, and what lines a wall never fills a room."""
COVERED_SPREAD = 0.01
"""By how much rooms of one type and density may differ from that."""
FREE_FLOOR: dict[Density, tuple[float, float]] = {"Sparse": (0.82, 1.0), "Moderate": (0.72, 0.84), "Dense": (0.5, 0.78)}
"""Least and greatest share of a room's floor that is free when the wish counts as met."""
