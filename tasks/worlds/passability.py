"""Whether a robot gets about a bare floor plan: exact, because rooms are rectangles and passages lie in their walls."""

from collections.abc import Sequence

from tasks.worlds.brief import Brief
from tasks.worlds.geometry import EPSILON_M, Box
from tasks.worlds.passages import Gap
from tasks.worlds.scoring import WALL_M, doorway_width, passable_width
from tasks.worlds.starting import START_CLEAR_M


def hindrance(brief: Brief, cells: Sequence[Box], gaps: Sequence[Gap], start: tuple[float, float] | None) -> str:
    """Returns what keeps the brief's robot from the start or from a room, for a person; empty for nothing.

    In a room without furniture a disc gets everywhere that it fits, and through every gap wider than itself.
    """
    names = [room.name for room in brief.rooms]
    floors = [cell.grown(-WALL_M / 2) for cell in cells]
    if start is None or not any(_holds(floor, start) for floor in floors):
        return f"no room holds the {START_CLEAR_M} m around the start that are kept clear"
    for name, floor in zip(names, floors, strict=True):
        if min(floor.width, floor.height) < passable_width(brief) - EPSILON_M:
            return f"{name} is {floor.width:.2f} x {floor.height:.2f} m, too narrow for the robot"
    reached = {next(room for room, floor in enumerate(floors) if _holds(floor, start))}
    wide = [gap.rooms for gap in gaps if gap.width > doorway_width(brief) - EPSILON_M]
    for _ in names:
        reached |= {room for pair in wide if reached & set(pair) for room in pair}
    if apart := [name for room, name in enumerate(names) if room not in reached]:
        return f"no way leads to {', '.join(apart)}"
    return ""


def _holds(floor: Box, start: tuple[float, float]) -> bool:
    x, y = start
    inner = floor.grown(EPSILON_M - START_CLEAR_M)
    return inner.x_min <= x <= inner.x_max and inner.y_min <= y <= inner.y_max
