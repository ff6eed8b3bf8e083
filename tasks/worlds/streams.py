"""Random streams: one for each floor plan, furnished room and variant, so that none depends on how many there are."""

import numpy as np

_FLOOR_PLAN, _MATERIALS, _ROOM, _DOORS, _VARIANT = 1, 2, 3, 4, 5


def floor_plan_stream(seed: int, floorplan_index: int, attempt: int = 0) -> np.random.Generator:
    """Returns the stream that draws a floor plan; each attempt has its own."""
    return _stream(seed, _FLOOR_PLAN, floorplan_index, attempt)


def materials_stream(seed: int, floorplan_index: int, interior_index: int) -> np.random.Generator:
    """Returns the stream that draws an interior's floors and walls."""
    return _stream(seed, _MATERIALS, floorplan_index, interior_index)


def doors_stream(seed: int, floorplan_index: int, interior_index: int, sub_seed: int) -> np.random.Generator:
    """Returns the stream that draws how an interior's doors look and stand.

    Args:
        seed: The generation's seed.
        floorplan_index: From 1.
        interior_index: From 1.
        sub_seed: How many tries were given up before.
    """
    return _stream(seed, _DOORS, floorplan_index, interior_index, sub_seed)


def room_stream(
    seed: int, floorplan_index: int, interior_index: int, sub_seed: int, *, room: int, attempt: int
) -> np.random.Generator:
    """Returns the stream that furnishes one room of an interior.

    Args:
        seed: The generation's seed.
        floorplan_index: From 1.
        interior_index: From 1.
        sub_seed: How many tries were given up before.
        room: The room's index.
        attempt: From 0; each attempt has its own stream.
    """
    return _stream(seed, _ROOM, floorplan_index, interior_index, sub_seed, room, attempt)


def variant_stream(seed: int, variant: int, sub_seed: int) -> np.random.Generator:
    """Returns the stream that changes a building of one's own.

    Args:
        seed: At least 0.
        variant: From 1.
        sub_seed: How many tries were given up before.
    """
    return _stream(seed, _VARIANT, variant, sub_seed)


def _stream(seed: int, *key: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))
