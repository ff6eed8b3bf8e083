"""What stands in a room: a programme by room type or the template's list, up to a density."""

from collections.abc import Iterator

import numpy as np

from specs.world import RoomType
from tasks.worlds.brief import RoomWish
from tasks.worlds.catalogue import CATALOGUE, ModelType
from tasks.worlds.compositions import COMPOSITIONS
from tasks.worlds.geometry import Box
from tasks.worlds.parts import Part, Size, Tints
from tasks.worlds.placing import Piece, Scene, place, place_companion

_OVERSHOOT = 1.2
_FEW_TRIES = 40

# What makes a room of its type, in order, then what may be added.
_PROGRAMMES: dict[RoomType, tuple[tuple[ModelType, ...], tuple[ModelType, ...]]] = {
    "Bedroom": (
        ("Beds", "Storage"),
        ("Dressers", "Desks", "Bookcases", "LivingRoomChairs", "StorageBenches", "Ottomans", "FloorLamps"),
    ),
    "Bathroom": (
        ("Toilets", "VanityCounters"),
        ("Showers", "Baths", "WashingMachinesAndDryers", "CornerCabinets"),
    ),
    "Living": (
        ("Sofas", "MediaStorage"),
        ("LivingRoomChairs", "Bookcases", "Ottomans", "SideboardsAndBuffets", "FloorLamps", "ConsoleTables", "Sofas"),
    ),
    "Dining": (
        ("DiningTables", "SideboardsAndBuffets"),
        ("BarCabinets", "CornerCabinets", "ServingCarts", "FloorLamps", "ConsoleTables", "DiningTables", "Bookcases"),
    ),
    "Kitchen": (
        ("Fridges", "Ovens", "DishWashers"),
        ("KitchenIslandsAndCarts", "DiningTables", "Storage", "ServingCarts", "WashingMachinesAndDryers"),
    ),
    "Hallway": (("ConsoleTables",), ("StorageBenches", "Storage", "FloorLamps", "Bookcases")),
    "Closet": (("Storage",), ("Dressers", "Storage", "StorageBenches", "WashingMachinesAndDryers")),
}  # fmt: skip


# What a home has several of; the rest comes once.
_REPEATED = frozenset(
    {"Storage", "Bookcases", "LivingRoomChairs", "Ottomans", "FloorLamps", "Dressers", "ConsoleTables", "Sofas"}
)


def furnish(
    rng: np.random.Generator, wish: RoomWish, floor: Box, keep_clear: tuple[Box, ...], *, solids: int, density: float
) -> tuple[Piece, ...]:
    """Returns the pieces of one room.

    Args:
        rng: The room's own stream.
        wish: The room as the template wants it.
        floor: Its floor.
        keep_clear: Floor before its passages.
        solids: How many primitives there may be at most.
        density: Share of the floor to cover, 0-1.
    """
    scene = Scene(floor, keep_clear)
    budget, target = solids, density * floor.area
    for kind in _sequence(rng, wish):
        size = draw_size(rng, kind)
        if covered(scene) + size[0] * size[1] > target * _OVERSHOOT and scene.pieces:
            continue
        piece = place(rng, scene, kind, CATALOGUE[kind], size) if count_solids(kind) <= budget else None
        if piece is None:
            continue
        scene.pieces.append(piece)
        budget -= count_solids(kind)
        budget = _accompany(rng, scene, piece, wish, budget)
        if covered(scene) >= target:
            break
    return tuple(scene.pieces)


def draw_size(rng: np.random.Generator, kind: ModelType) -> Size:
    """Returns a size for a piece of that type, in whole centimetres."""
    model = CATALOGUE[kind]
    ranges = (model.width_m, model.depth_m, model.height_m)
    width, depth, height = (round(low + (high - low) * float(rng.random()), 2) for low, high in ranges)
    return width, depth, height


def covered(scene: Scene) -> float:
    """Returns the floor that the pieces cover (square metres)."""
    return sum(piece.size[0] * piece.size[1] for piece in scene.pieces)


def count_solids(kind: ModelType) -> int:
    """Returns how many primitives a piece of that type has."""
    return len(compose(kind, (1.0, 1.0, 1.0), Tints((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))))


def compose(kind: ModelType, size: Size, tints: Tints) -> tuple[Part, ...]:
    """Returns the primitives of a piece, in its own frame."""
    return COMPOSITIONS[kind](size, tints)


def _sequence(rng: np.random.Generator, wish: RoomWish) -> Iterator[ModelType]:
    """Yields the types to try, in order: what makes the room first, the rest by chance."""
    essential, extra = _PROGRAMMES[wish.type]
    if wish.furniture is None:
        yield from essential
        yield from _shuffled(rng, extra)
        yield from _shuffled(rng, tuple(kind for kind in extra if kind in _REPEATED))
        return
    if not wish.furniture:
        return
    listed = tuple(dict.fromkeys(wish.furniture))
    yield from (kind for kind in essential if kind in listed)
    yield from _shuffled(rng, tuple(kind for kind in listed if kind not in essential))
    for _ in range(_FEW_TRIES):
        yield listed[int(rng.integers(len(listed)))]


def _shuffled(rng: np.random.Generator, kinds: tuple[ModelType, ...]) -> Iterator[ModelType]:
    return (kinds[place] for place in np.argsort(rng.random(len(kinds)), kind="stable"))


def _accompany(rng: np.random.Generator, scene: Scene, owner: Piece, wish: RoomWish, budget: int) -> int:
    """Adds what belongs to a piece; returns the primitives that are left."""
    for companion in CATALOGUE[owner.type].companions:
        size = draw_size(rng, companion.type)
        listed = wish.furniture is None or companion.type in wish.furniture
        if not listed or count_solids(companion.type) > budget:
            continue
        piece = place_companion(scene, owner, companion, size)
        if piece is not None:
            scene.pieces.append(piece)
            budget -= count_solids(companion.type)
    return budget
