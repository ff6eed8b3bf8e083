"""What the three densities of furniture mean, in figures."""

from tasks.worlds.brief import Density

COVERED: dict[Density, float] = {"Sparse": 0.1, "Moderate": 0.19, "Dense": 0.3}
"""Share of a room's floor that furniture shall cover."""
FREE_FLOOR: dict[Density, tuple[float, float]] = {"Sparse": (0.85, 1.0), "Moderate": (0.74, 0.9), "Dense": (0.5, 0.8)}
"""Least and greatest share of a room's floor that is free when the wish counts as met."""
