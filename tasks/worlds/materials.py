"""Floorings and wall coverings: RoboMaker's names, and what each looks like.

Names are matched ignoring case and spaces, because the guide and its samples spell them both ways
(docs/reference/robomaker.md, section 6).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from specs.data.world import Color, Finish, Pattern, RoomType
from tasks.worlds.resolved_template import ResolvedTemplate

Scheme = tuple[Color, Color]
"""The colour of a surface, and of its joints, grain or print."""


@dataclass(frozen=True)
class SurfaceMaterial:
    """What a flooring or a wall covering looks like.

    Attributes:
        pattern: How its surface is divided.
        repeat_m: One unit of the pattern (along, then across or up).
        schemes: Colours that it comes in.
    """

    pattern: Pattern
    repeat_m: tuple[float, float]
    schemes: tuple[Scheme, ...]


# Planks, tiles and bricks are as shops sell them (laminate 1.2 x 0.19 m; brick courses 0.25 x 0.075 m with the joint,
# DIN 105 normal format 240 x 115 x 71 mm).
FLOORINGS: dict[str, SurfaceMaterial] = {
    "Carpet": SurfaceMaterial(
        "fibres",
        (0.02, 0.02),
        (
            ((0.72, 0.68, 0.62), (0.65, 0.61, 0.55)),
            ((0.55, 0.58, 0.6), (0.48, 0.51, 0.53)),
            ((0.6, 0.5, 0.44), (0.52, 0.43, 0.37)),
            ((0.46, 0.5, 0.44), (0.4, 0.44, 0.38)),
        ),
    ),
    "Concrete": SurfaceMaterial(
        "plain",
        (1.0, 1.0),
        (((0.66, 0.66, 0.65), (0.6, 0.6, 0.59)), ((0.56, 0.56, 0.56), (0.5, 0.5, 0.5))),
    ),
    "Floorboards": SurfaceMaterial(
        "planks",
        (1.2, 0.19),
        (
            ((0.73, 0.56, 0.38), (0.6, 0.44, 0.29)),
            ((0.82, 0.69, 0.52), (0.7, 0.57, 0.41)),
            ((0.52, 0.37, 0.25), (0.41, 0.28, 0.18)),
            ((0.78, 0.74, 0.68), (0.67, 0.63, 0.57)),
        ),
    ),
    "Linoleum": SurfaceMaterial(
        "plain",
        (1.0, 1.0),
        (
            ((0.78, 0.76, 0.66), (0.72, 0.7, 0.6)),
            ((0.62, 0.7, 0.68), (0.56, 0.64, 0.62)),
            ((0.7, 0.55, 0.46), (0.63, 0.48, 0.4)),
        ),
    ),
    "Parquetry": SurfaceMaterial(
        "parquet",
        (0.4, 0.1),
        (((0.64, 0.44, 0.27), (0.54, 0.35, 0.2)), ((0.76, 0.58, 0.38), (0.66, 0.48, 0.3))),
    ),
    "Tiles": SurfaceMaterial(
        "tiles",
        (0.3, 0.3),
        (
            ((0.83, 0.84, 0.83), (0.66, 0.67, 0.66)),
            ((0.72, 0.76, 0.78), (0.86, 0.88, 0.88)),
            ((0.78, 0.68, 0.58), (0.64, 0.56, 0.48)),
            ((0.45, 0.48, 0.5), (0.62, 0.64, 0.65)),
        ),
    ),
}
WALLS: dict[str, SurfaceMaterial] = {
    "Brick": SurfaceMaterial(
        "bricks",
        (0.25, 0.083),
        (((0.66, 0.36, 0.28), (0.8, 0.76, 0.7)), ((0.82, 0.8, 0.77), (0.7, 0.68, 0.65))),
    ),
    "Concrete": SurfaceMaterial("plain", (1.0, 1.0), (((0.72, 0.72, 0.71), (0.66, 0.66, 0.65)),)),
    "Stone": SurfaceMaterial(
        "stones",
        (0.5, 0.25),
        (((0.62, 0.6, 0.55), (0.5, 0.48, 0.44)), ((0.74, 0.7, 0.62), (0.62, 0.58, 0.5))),
    ),
    "Tiles": SurfaceMaterial(
        "tiles",
        (0.2, 0.2),
        (
            ((0.92, 0.94, 0.94), (0.78, 0.81, 0.82)),
            ((0.72, 0.84, 0.86), (0.9, 0.94, 0.95)),
            ((0.6, 0.74, 0.68), (0.86, 0.9, 0.88)),
            ((0.9, 0.86, 0.78), (0.76, 0.72, 0.65)),
        ),
    ),
    "Wood panels": SurfaceMaterial(
        "panels",
        (0.15, 2.4),
        (((0.7, 0.54, 0.38), (0.58, 0.43, 0.29)), ((0.86, 0.85, 0.81), (0.75, 0.74, 0.7))),
    ),
    "Wall paint": SurfaceMaterial(
        "plain",
        (1.0, 1.0),
        (
            ((0.94, 0.92, 0.87), (0.94, 0.92, 0.87)),
            ((0.95, 0.95, 0.94), (0.95, 0.95, 0.94)),
            ((0.82, 0.87, 0.84), (0.82, 0.87, 0.84)),
            ((0.8, 0.85, 0.91), (0.8, 0.85, 0.91)),
            ((0.93, 0.85, 0.77), (0.93, 0.85, 0.77)),
            ((0.88, 0.82, 0.83), (0.88, 0.82, 0.83)),
        ),
    ),
    "Wallpaper": SurfaceMaterial(
        "stripes",
        (0.12, 2.4),
        (
            ((0.84, 0.82, 0.88), (0.77, 0.74, 0.83)),
            ((0.88, 0.86, 0.78), (0.82, 0.79, 0.68)),
            ((0.78, 0.86, 0.85), (0.7, 0.8, 0.79)),
        ),
    ),
}
_USUAL_FLOORS: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("Carpet", "Floorboards", "Parquetry"),
    "Bathroom": ("Tiles", "Linoleum"),
    "Living": ("Floorboards", "Parquetry", "Carpet"),
    "Dining": ("Floorboards", "Parquetry", "Tiles"),
    "Kitchen": ("Tiles", "Linoleum", "Concrete"),
    "Hallway": ("Floorboards", "Tiles", "Parquetry"),
    "Closet": ("Carpet", "Floorboards"),
}
_USUAL_WALLS: dict[RoomType, tuple[str, ...]] = {
    "Bedroom": ("Wall paint", "Wallpaper"),
    "Bathroom": ("Tiles",),
    "Living": ("Wall paint", "Wallpaper", "Brick"),
    "Dining": ("Wall paint", "Wood panels"),
    "Kitchen": ("Wall paint", "Tiles"),
    "Hallway": ("Wall paint", "Wallpaper"),
    "Closet": ("Wall paint",),
}


@dataclass(frozen=True)
class Surfaces:
    """What one room's floor and walls are covered with."""

    flooring: Finish
    walls: Finish


def draw_surfaces(resolved: ResolvedTemplate, rng: np.random.Generator) -> tuple[Surfaces, ...]:
    """Returns each room's surfaces; a wish for materials that nobody knows leaves them to the room's type."""
    return tuple(
        Surfaces(
            _draw(rng, room.floorings, FLOORINGS, _USUAL_FLOORS[room.type]),
            _draw(rng, room.walls, WALLS, _USUAL_WALLS[room.type]),
        )
        for room in resolved.rooms
    )


def known_name(wished: str, known: Mapping[str, SurfaceMaterial]) -> str | None:
    """Returns the material that a template means, None for none."""
    plain = _plain(wished)
    return next((name for name in known if _plain(name) == plain), None)


def _draw(
    rng: np.random.Generator, wished: tuple[str, ...], known: dict[str, SurfaceMaterial], usual: tuple[str, ...]
) -> Finish:
    choice = [name for wish in wished if (name := known_name(wish, known))] or list(usual)
    name = choice[int(rng.integers(len(choice)))]
    material = known[name]
    color, accent = material.schemes[int(rng.integers(len(material.schemes)))]
    return Finish(material=name, pattern=material.pattern, color=color, accent=accent, repeat_m=material.repeat_m)


@lru_cache(maxsize=256)
def _plain(name: str) -> str:
    return name.replace(" ", "").lower()
