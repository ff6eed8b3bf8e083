"""What stands around the plan: title, dimensions, scale bar, floorings, north."""

from xml.etree import ElementTree as ET

from specs.data.world import World
from tasks.export.drawing.floor_patterns import area_m2, floor_color, pattern_key
from tasks.export.drawing.plan_page import PageBox, PageScale, element, fit_text, rectangle, text_width

_TITLE_SIZE, _SUBTITLE_SIZE, _SMALL_SIZE, _SWATCH_SIZE = 26.0, 14.0, 12.0, 11.0
_TICK = 5.0
_SCALE_STEPS_M = (0.5, 1.0, 2.0, 5.0, 10.0)
_SWATCH = PageBox(0.0, 0.0, 22.0, 14.0)


def draw_title(parent: ET.Element, world: World, box: PageBox) -> None:
    """Adds the world's name and, below it, where it comes from."""
    total_m2 = sum(area_m2(room.floor) for room in world.rooms)
    plural = "" if len(world.rooms) == 1 else "s"
    facts = (
        f"{len(world.rooms)} room{plural}, {total_m2:.1f} m² · ceiling {world.ceiling_height_m:.2f} m · "
        f"seed {world.seed} · {world.generation}"
    )
    name = fit_text(world.name, _TITLE_SIZE, box.width)
    element(parent, "text", name, x=box.left, y=box.top + _TITLE_SIZE, font_size=_TITLE_SIZE, class_="name")
    shown = fit_text(facts, _SUBTITLE_SIZE, box.width)
    element(parent, "text", shown, x=box.left, y=box.bottom, font_size=_SUBTITLE_SIZE, class_="quiet")


def draw_dimensions(parent: ET.Element, world: World, sheet: PageScale, offset: float) -> None:
    """Adds the outer dimensions of the building, above it and to its left, ``offset`` page units away.

    Args:
        parent: What the lines become part of.
        world: Whose building.
        sheet: Where the world lies on the page.
        offset: Distance from the building in page units.
    """
    box = sheet.box(world.footprint)
    group = element(parent, "g", class_="dimension")
    top, left = box.top - offset, box.left - offset
    width_m = world.footprint.x_max_m - world.footprint.x_min_m
    height_m = world.footprint.y_max_m - world.footprint.y_min_m
    tick = f"m0 {-_TICK}v{2 * _TICK}m0 {-_TICK}"
    element(group, "path", d=f"M{box.left:.2f} {top:.2f}{tick}H{box.right:.2f}{tick}")
    tick = f"m{-_TICK} 0h{2 * _TICK}m{-_TICK} 0"
    element(group, "path", d=f"M{left:.2f} {box.top:.2f}{tick}V{box.bottom:.2f}{tick}")
    x, y = box.center
    element(group, "text", f"{width_m:.2f} m", x=x, y=top - 6, font_size=_SMALL_SIZE)
    turn = f"rotate(-90 {left - 6:.2f} {y:.2f})"
    element(group, "text", f"{height_m:.2f} m", x=left - 6, y=y, font_size=_SMALL_SIZE, transform=turn)


def draw_scale_bar(parent: ET.Element, sheet: PageScale, left: float, top: float, longest: float) -> float:
    """Adds a bar of four equal parts, as long as fits into ``longest`` page units; returns where it ends.

    Args:
        parent: What the bar becomes part of.
        sheet: Where the world lies on the page.
        left: Where the bar begins, in page units.
        top: Where its upper edge is, in page units.
        longest: How long it may be, in page units.
    """
    fitting = [step_m for step_m in _SCALE_STEPS_M if 4 * step_m * sheet.units_per_m <= longest]
    part_m = max(fitting, default=_SCALE_STEPS_M[0])
    part = part_m * sheet.units_per_m
    group = element(parent, "g", class_="scale")
    for number in range(4):
        box = PageBox(left + number * part, top, left + (number + 1) * part, top + 6)
        rectangle(group, box, class_="dark" if number % 2 == 0 else "bright")
    for number in range(0, 5, 2):
        unit = " m" if number == 4 else ""
        text = f"{number * part_m:g}{unit}"
        element(group, "text", text, x=left + number * part, y=top + 22, font_size=_SMALL_SIZE, class_="tick")
    return left + 4 * part


def draw_floorings(parent: ET.Element, world: World, sheet: PageScale, box: PageBox) -> None:
    """Adds a swatch of every flooring with its name, as many as fit into a row that ends at the box's right.

    Args:
        parent: What the row becomes part of.
        world: Whose floorings.
        sheet: Where the world lies on the page.
        box: The box that the row must fit into.
    """
    group = element(parent, "g", class_="floorings")
    seen: list[tuple[str, str, str]] = []
    for room in world.rooms:
        entry = (room.flooring.material, floor_color(room.flooring), pattern_key(room.flooring, sheet))
        if entry not in seen:
            seen.append(entry)
    right = box.right
    for material, color, key in reversed(seen):
        left = right - text_width(material, _SWATCH_SIZE) - _SWATCH.width - 6
        if left < box.left:
            return
        swatch = PageBox(left, box.top - 2, left + _SWATCH.width, box.top - 2 + _SWATCH.height)
        rectangle(group, swatch, fill=color, class_="swatch")
        if key:
            rectangle(group, swatch, fill=f"url(#{key})")
        element(group, "text", material, x=swatch.right + 6, y=swatch.bottom - 3, font_size=_SWATCH_SIZE)
        right = left - 16


def draw_north(parent: ET.Element, x: float, top: float) -> None:
    """Adds the north arrow: y is north and x is east, as ROS has it (REP 103)."""
    group = element(parent, "g", class_="north")
    element(group, "title", "North is +y, east is +x (REP 103)")
    element(group, "circle", cx=x, cy=top + 15, r=15.0, class_="ring")
    element(group, "path", d=f"M{x:.2f} {top + 2:.2f}l6 22l-6 -5l-6 5z")
    element(group, "text", "N", x=x, y=top - 5, font_size=_SMALL_SIZE, class_="tick name")
