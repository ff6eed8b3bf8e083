"""Floors on the plan: every flooring in its colour, divided as its pattern is, to scale."""

from collections.abc import Callable, Mapping
from xml.etree import ElementTree as ET

from specs.data.world import Finish, Pattern, Rectangle, Room, World
from specs.digest import digest
from tasks.export.drawing.plan_page import PageScale, css_color, element, rectangle

_FLOOR_TOWARDS_WHITE, _JOINT_TOWARDS_WHITE = 0.42, 0.25
_FEWEST_UNITS = 3.0  # lines closer than this on the page would be a grey, not a pattern


def draw_patterns(definitions: ET.Element, world: World, sheet: PageScale) -> None:
    """Adds a pattern of lines for each flooring of the world that is divided."""
    seen: set[str] = set()
    for room in world.rooms:
        key = pattern_key(room.flooring, sheet)
        if key and key not in seen:
            seen.add(key)
            _draw_pattern(definitions, room.flooring, sheet.units_per_m, key)


def draw_floors(parent: ET.Element, world: World, sheet: PageScale) -> None:
    """Adds the footprint and every room's floor."""
    rectangle(parent, sheet.box(world.footprint), class_="threshold")
    for room in world.rooms:
        group = element(parent, "g", class_="room")
        element(group, "title", _facts(room))
        box = sheet.box(room.floor)
        rectangle(group, box, fill=floor_color(room.flooring))
        if key := pattern_key(room.flooring, sheet):
            rectangle(group, box, fill=f"url(#{key})")


def floor_color(finish: Finish) -> str:
    """Returns the paper's colour of a flooring: pale, so that furniture and text stand out."""
    return css_color(finish.color, _FLOOR_TOWARDS_WHITE)


def pattern_key(finish: Finish, sheet: PageScale) -> str:
    """Returns the id of the pattern that a flooring is drawn with; empty for none."""
    if finish.pattern not in _PATHS or min(finish.repeat_m) * sheet.units_per_m < _FEWEST_UNITS:
        return ""
    return f"floor-{digest(finish)[:8]}"


def area_m2(area: Rectangle) -> float:
    """Returns the area of a rectangle on the floor."""
    return (area.x_max_m - area.x_min_m) * (area.y_max_m - area.y_min_m)


def _draw_pattern(definitions: ET.Element, finish: Finish, units_per_m: float, key: str) -> None:
    along, across = (extent_m * units_per_m for extent_m in finish.repeat_m)
    width, height, path = _PATHS[finish.pattern](along, across)
    pattern = element(definitions, "pattern", id=key, width=width, height=height, patternUnits="userSpaceOnUse")
    element(pattern, "path", d=path, class_="joint", stroke=css_color(finish.accent, _JOINT_TOWARDS_WHITE))


def _planks(along: float, across: float) -> tuple[float, float, str]:
    rows = [
        f"M0 {row * across:.2f}H{along:.2f}M{row * 3 % 4 * along / 4:.2f} {row * across:.2f}v{across:.2f}"
        for row in range(4)
    ]
    return along, 4 * across, "".join(rows)


def _herringbone(along: float, across: float) -> tuple[float, float, str]:
    """Returns staves along x and y by turns; the pattern's side is two staves' length."""
    ratio = max(1, round(along / across))
    cells, cell = 2 * ratio, along / ratio
    lines: list[str] = []
    for number in range(cells):
        start = number * cell
        # A stave along x begins where row and column are equal, one along y a row below; both may wrap around.
        for wrapped in (start, start - cells * cell):
            lines.append(f"M{wrapped:.2f} {start:.2f}h{along:.2f}v{cell:.2f}h{-along:.2f}z")
            lines.append(f"M{start:.2f} {wrapped + cell:.2f}h{cell:.2f}v{along:.2f}h{-cell:.2f}z")
    return cells * cell, cells * cell, "".join(lines)


def _tiles(along: float, across: float) -> tuple[float, float, str]:
    return along, across, f"M0 0V{across:.2f}M0 0H{along:.2f}"


def _bricks(along: float, across: float) -> tuple[float, float, str]:
    return (
        along,
        2 * across,
        (f"M0 0H{along:.2f}M0 {across:.2f}H{along:.2f}M0 0V{across:.2f}M{along / 2:.2f} {across:.2f}v{across:.2f}"),
    )


def _boards(along: float, across: float) -> tuple[float, float, str]:
    return along, across, f"M0 0V{across:.2f}"


_PATHS: Mapping[Pattern, Callable[[float, float], tuple[float, float, str]]] = {
    "planks": _planks,
    "parquet": _herringbone,
    "tiles": _tiles,
    "bricks": _bricks,
    "stones": _bricks,
    "panels": _boards,
    "stripes": _boards,
}


def _facts(room: Room) -> str:
    floor = room.floor
    size = f"{floor.x_max_m - floor.x_min_m:.2f} by {floor.y_max_m - floor.y_min_m:.2f} m"
    materials = f"floor {room.flooring.material}, walls {room.walls.material}"
    return f"{room.name}: {room.type}, {area_m2(floor):.1f} m², {size}, {materials}"
