"""A world cut open to look into: walls end at a height, and have holes where windows are. For pictures only."""

from collections.abc import Iterator, Sequence

from specs.data.world import Color, Door, Solid, Window, World

CUT_COLOR: Color = (0.93, 0.92, 0.90)
_SMALLEST_M = 0.005


def cut_open(world: World, height_m: float) -> World:
    """Returns the world without what of its walls, doors and windows is above a height; furniture stays whole."""
    windows = [window for window in world.windows if window.bottom_m < height_m]
    lowered = [wall for each in world.walls if (wall := _lowered(each, height_m))]
    walls = tuple(part.model_copy(update={"color": CUT_COLOR}) for wall in lowered for part in _pierced(wall, windows))
    return world.model_copy(
        update={
            "walls": walls,
            "doors": tuple(_lowered_door(door, height_m) for door in world.doors),
            "windows": tuple(window.model_copy(update={"top_m": min(window.top_m, height_m)}) for window in windows),
            "ceiling_height_m": min(world.ceiling_height_m, height_m),
        }
    )


def _lowered_door(door: Door, height_m: float) -> Door:
    return door.model_copy(update={"leaf": _lowered(door.leaf, height_m) or door.leaf})


def _lowered(solid: Solid, height_m: float) -> Solid | None:
    bottom_m = solid.center_m[2] - solid.half_extents_m[2]
    top_m = min(height_m, solid.center_m[2] + solid.half_extents_m[2])
    return _part(solid, 2, bottom_m, top_m) if top_m - bottom_m > _SMALLEST_M else None


def _pierced(wall: Solid, windows: Sequence[Window]) -> Iterator[Solid]:
    """Yields what of a wall is left beside, below and above its windows."""
    window = next((window for window in windows if _is_in(window, wall)), None)
    if window is None:
        yield wall
        return
    along = 0 if window.along == "x" else 1
    start_m, end_m = window.center_m[along] - window.width_m / 2, window.center_m[along] + window.width_m / 2
    low_m, high_m = wall.center_m[along] - wall.half_extents_m[along], wall.center_m[along] + wall.half_extents_m[along]
    others = [other for other in windows if other != window]
    for name, from_m, to_m in (("first", low_m, start_m), ("last", end_m, high_m)):
        if to_m - from_m > _SMALLEST_M:
            yield from _pierced(_part(wall, along, from_m, to_m, name), others)
    pillar = _part(wall, along, start_m, end_m)
    bottom_m, top_m = wall.center_m[2] - wall.half_extents_m[2], wall.center_m[2] + wall.half_extents_m[2]
    for name, from_m, to_m in (("sill", bottom_m, window.bottom_m), ("head", window.top_m, top_m)):
        if to_m - from_m > _SMALLEST_M:
            yield _part(pillar, 2, from_m, to_m, name)


def _is_in(window: Window, wall: Solid) -> bool:
    along, across = (0, 1) if window.along == "x" else (1, 0)
    beside_m = abs(window.center_m[across] - wall.center_m[across])
    inside_m = wall.half_extents_m[along] - abs(window.center_m[along] - wall.center_m[along])
    return beside_m < wall.half_extents_m[across] and inside_m > window.width_m / 2 - _SMALLEST_M


def _part(solid: Solid, axis: int, from_m: float, to_m: float, name: str = "") -> Solid:
    """Returns the part of a straight solid between two places on an axis."""
    center_m, half_extents_m = list(solid.center_m), list(solid.half_extents_m)
    center_m[axis], half_extents_m[axis] = (from_m + to_m) / 2, (to_m - from_m) / 2
    update = {"center_m": tuple(center_m), "half_extents_m": tuple(half_extents_m)}
    return solid.model_copy(update={**update, "name": f"{solid.name}/{name}" if name else solid.name})
