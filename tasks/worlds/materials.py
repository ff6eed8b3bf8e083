"""Floorings and wall coverings: RoboMaker's names, and a colour for each.

Names are matched ignoring case and spaces, because the guide and its samples spell them both ways (semantics 6).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from specs.world import RoomType
from tasks.worlds.brief import Brief
from tasks.worlds.streams import materials_stream

Color = tuple[float, float, float]

FLOORINGS: dict[str, Color] = {
    "Carpet": (0.72, 0.68, 0.62),
    "Concrete": (0.66, 0.66, 0.65),
    "Floorboards": (0.73, 0.56, 0.38),
    "Linoleum": (0.78, 0.76, 0.66),
    "Parquetry": (0.64, 0.44, 0.27),
    "Tiles": (0.83, 0.84, 0.83),
}
WALLS: dict[str, Color] = {
    "Brick": (0.66, 0.36, 0.28),
    "Concrete": (0.72, 0.72, 0.71),
    "Stone": (0.62, 0.6, 0.55),
    "Tiles": (0.85, 0.9, 0.91),
    "Wood panels": (0.7, 0.54, 0.38),
    "Wall paint": (0.93, 0.91, 0.86),
    "Wallpaper": (0.84, 0.82, 0.88),
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
    """What one room's floor and walls are made of."""

    floor: str
    wall: str

    @property
    def floor_color(self) -> Color:
        """Colour of the floor."""
        return FLOORINGS[self.floor]

    @property
    def wall_color(self) -> Color:
        """Colour of the walls."""
        return WALLS[self.wall]


def draw_surfaces(
    brief: Brief, *, seed: int, floorplan_index: int, interior_index: int
) -> tuple[tuple[Surfaces, ...], tuple[str, ...]]:
    """Returns each room's surfaces, and one sentence for each wished material that nobody knows."""
    rng = materials_stream(seed, floorplan_index, interior_index)
    drawn: list[Surfaces] = []
    for room in brief.rooms:
        floor = _draw(rng, room.floorings, FLOORINGS, _USUAL_FLOORS[room.type])
        drawn.append(Surfaces(floor, _draw(rng, room.walls, WALLS, _USUAL_WALLS[room.type])))
    return tuple(drawn), (*_unknown(brief, "floorings"), *_unknown(brief, "walls"))


def _draw(rng: np.random.Generator, wished: tuple[str, ...], known: dict[str, Color], usual: tuple[str, ...]) -> str:
    names = {_plain(name): name for name in known}
    choice = [names[_plain(wish)] for wish in wished if _plain(wish) in names] or usual
    return choice[int(rng.integers(len(choice)))]


def _unknown(brief: Brief, where: Literal["floorings", "walls"]) -> Iterator[str]:
    known = FLOORINGS if where == "floorings" else WALLS
    plain = {_plain(name) for name in known}
    for room in brief.rooms:
        for wish in room.floorings if where == "floorings" else room.walls:
            if _plain(wish) not in plain:
                yield f"{room.name}: no material {wish!r} for {where}; there are {', '.join(known)}"


def _plain(name: str) -> str:
    return name.replace(" ", "").lower()
