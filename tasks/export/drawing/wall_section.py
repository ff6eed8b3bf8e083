"""The walls of the plan, cut one metre above the floor, the start, and the names of the rooms."""

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from specs.data.world import Room, Solid, World
from tasks.export.drawing.door_symbols import swing_box
from tasks.export.drawing.floor_patterns import area_m2
from tasks.export.drawing.furniture_outlines import piece_box
from tasks.export.drawing.labels import Label, place_label
from tasks.export.drawing.plan_page import (
    Attributes,
    PageBox,
    PageScale,
    bottom_m,
    draw_solid,
    element,
    text_width,
    top_m,
)

START_RADIUS_M = 1.0  # docs/reference/robomaker.md, section 5: the cylinder around the origin that is always free
_CUT_M = 1.0  # an architect's plan looks down from about here
_MARK, _MARK_SIZE = "start", 11.5


def draw_walls(parent: ET.Element, walls: Sequence[Solid], sheet: PageScale) -> None:
    """Adds the walls: black where the cut goes through them, pale below it, dashed above it (lintels)."""
    for wall in sorted(walls, key=top_m):
        draw_solid(parent, wall, sheet, {"class_": _wall_class(wall)})


def draw_start(parent: ET.Element, sheet: PageScale) -> PageBox:
    """Adds the origin, the circle of 1 m that is free and the axes (x red, y green); returns the box of its text."""
    group = element(parent, "g", class_="start")
    element(group, "title", "Start of the robot: the origin (0, 0); 1 m around it is free")
    x, y, unit = sheet.x(0.0), sheet.y(0.0), sheet.units_per_m
    element(group, "circle", cx=x, cy=y, r=START_RADIUS_M * unit, class_="clear")
    arm = 0.35 * unit
    element(group, "path", d=f"M{x:.2f} {y:.2f}h{arm:.2f}m-5 -4l5 4l-5 4", class_="axis-x")
    element(group, "path", d=f"M{x:.2f} {y:.2f}v{-arm:.2f}m-4 5l4 -5l4 5", class_="axis-y")
    element(group, "circle", cx=x, cy=y, r=3.5, class_="origin")
    element(group, "text", _MARK, x=x - 6, y=y + 15, class_="mark", font_size=_MARK_SIZE, text_anchor="end")
    return PageBox(x - 6 - text_width(_MARK, _MARK_SIZE), y + 4, x - 6, y + 18)


def draw_room_labels(parent: ET.Element, world: World, sheet: PageScale) -> list[PageBox]:
    """Adds name, area and free share of every room, where they cover least; returns the boxes of the texts."""
    reach = START_RADIUS_M * sheet.units_per_m
    x, y = sheet.x(0.0), sheet.y(0.0)
    axes = PageBox(x - 0.55 * reach, y - 0.45 * reach, x + 0.45 * reach, y + 0.3 * reach)
    obstacles = [piece_box(piece, sheet).grown(3.0) for piece in world.furniture]
    obstacles += [axes, *(swing_box(door, sheet) for door in world.doors)]
    start = PageBox(x - reach, y - reach, x + reach, y + reach)
    free = {figures.room: figures.free_floor_share for figures in world.certificate.rooms}
    labels: list[PageBox] = []
    for room in world.rooms:
        area = f"{area_m2(room.floor):.1f} m²"
        details = [f"{area} · {100 * free[room.name]:.0f} % free", area] if room.name in free else [area]
        label = place_label(room.name, details, sheet.box(room.floor), obstacles, [start])
        _room_label(parent, label, room)
        labels.append(label.box)
    return labels


def _room_label(parent: ET.Element, label: Label, room: Room) -> None:
    turn: Attributes = {"transform": f"rotate(-90 {label.x:.2f} {label.y:.2f})"} if label.upright else {}
    group = element(parent, "g", class_="label", **turn)
    if label.name != room.name:
        element(group, "title", room.name)
    baseline = label.y - 2 if label.detail else label.y + 0.36 * label.size
    element(group, "text", label.name, x=label.x, y=baseline, font_size=label.size, class_="name")
    if label.detail:
        y = label.y + label.detail_size
        element(group, "text", label.detail, x=label.x, y=y, font_size=label.detail_size)


def _wall_class(wall: Solid) -> str:
    if bottom_m(wall) >= _CUT_M:
        return "lintel"
    return "wall" if top_m(wall) > _CUT_M else "low-wall"
