"""Ways through the walls on the plan: gaps, hinged doors with the arcs of their swing, windows."""

import math
from xml.etree import ElementTree as ET

from specs.data.world import Door, Passage, Rectangle, World
from tasks.export.drawing.plan_page import PageBox, PageScale, draw_solid, element, rectangle


def draw_passages(parent: ET.Element, world: World, sheet: PageScale) -> None:
    """Adds every doorway and opening as a gap, with its width as tooltip."""
    for passage in world.passages:
        group = element(parent, "g", class_=passage.kind.lower())
        wish = "" if passage.desired else ", added so that every room can be reached"
        first, second = passage.rooms
        element(group, "title", f"{passage.kind}, {passage.width_m:.2f} m: {first} to {second}{wish}")
        rectangle(group, sheet.box(_gap(passage, world.wall_thickness_m)), class_="gap")


def draw_doors(parent: ET.Element, world: World, sheet: PageScale) -> None:
    """Adds every hinged door as it stands, and the arc that its tip describes between shut and fully open."""
    for door in world.doors:
        group = element(parent, "g", class_="door")
        element(group, "title", f"{door.name}: {door.open_percent:g} % open, swings into {door.opens_into}")
        element(group, "path", d=_arc(door, sheet), class_="swing")
        draw_solid(group, door.leaf, sheet, {"class_": "leaf"})


def draw_windows(parent: ET.Element, world: World, sheet: PageScale) -> None:
    """Adds every window: the wall's faces and, between them, the glass."""
    for window in world.windows:
        group = element(parent, "g", class_="window")
        height = f"{window.bottom_m:.2f} to {window.top_m:.2f} m"
        element(group, "title", f"Window, {window.width_m:.2f} m, {height}: {window.room}")
        box = sheet.box(_span(window.center_m, window.width_m, window.along, world.wall_thickness_m))
        rectangle(group, box, class_="pane")
        x, y = box.center
        middle = (
            f"M{box.left:.2f} {y:.2f}H{box.right:.2f}"
            if window.along == "x"
            else f"M{x:.2f} {box.top:.2f}V{box.bottom:.2f}"
        )
        element(group, "path", d=middle, class_="glass")


def swing_box(door: Door, sheet: PageScale) -> PageBox:
    """Returns the page box that a door sweeps."""
    x, y = sheet.x(door.hinge_m[0]), sheet.y(door.hinge_m[1])
    tips = [_tip(door, yaw_rad, sheet) for yaw_rad in (door.closed_yaw_rad, door.open_yaw_rad)]
    xs, ys = [x, *(tip[0] for tip in tips)], [y, *(tip[1] for tip in tips)]
    return PageBox(min(xs), min(ys), max(xs), max(ys))


def _arc(door: Door, sheet: PageScale) -> str:
    radius = _length_m(door) * sheet.units_per_m
    (from_x, from_y), (to_x, to_y) = (
        _tip(door, yaw_rad, sheet) for yaw_rad in (door.closed_yaw_rad, door.open_yaw_rad)
    )
    # Counter-clockwise with y up; SVG's sweep flag 1 is clockwise on the page.
    sweep = 0 if math.remainder(door.open_yaw_rad - door.closed_yaw_rad, 2 * math.pi) > 0 else 1
    x, y = sheet.x(door.hinge_m[0]), sheet.y(door.hinge_m[1])
    return f"M{from_x:.2f} {from_y:.2f}A{radius:.2f} {radius:.2f} 0 0 {sweep} {to_x:.2f} {to_y:.2f}L{x:.2f} {y:.2f}"


def _tip(door: Door, yaw_rad: float, sheet: PageScale) -> tuple[float, float]:
    length_m = _length_m(door)
    x_m, y_m = door.hinge_m
    return sheet.x(x_m + length_m * math.cos(yaw_rad)), sheet.y(y_m + length_m * math.sin(yaw_rad))


def _length_m(door: Door) -> float:
    return 2 * max(door.leaf.half_extents_m[:2])


def _gap(passage: Passage, thickness_m: float) -> Rectangle:
    return _span(passage.center_m, passage.width_m, passage.along, thickness_m)


def _span(center_m: tuple[float, float], width_m: float, along: str, thickness_m: float) -> Rectangle:
    half_m = width_m / 2, thickness_m / 2
    half_x_m, half_y_m = half_m if along == "x" else half_m[::-1]
    x_m, y_m = center_m
    return Rectangle(x_min_m=x_m - half_x_m, x_max_m=x_m + half_x_m, y_min_m=y_m - half_y_m, y_max_m=y_m + half_y_m)
