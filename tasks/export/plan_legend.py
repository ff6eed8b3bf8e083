"""What stands around the plan: title, dimensions, scale bar, north, certificate."""

from xml.etree import ElementTree as ET

from specs.world import Certificate, World
from tasks.export.plan_page import Box, Sheet, element, fitted, rectangle

_TITLE_SIZE, _SUBTITLE_SIZE, _SMALL_SIZE = 26.0, 14.0, 12.0
_VALUE_SIZE = 17.0
_TICK = 5.0
_WISH_LINE = 17.0
_SCALE_STEPS_M = (0.5, 1.0, 2.0, 5.0, 10.0)
MAX_WISHES = 6


def draw_title(parent: ET.Element, world: World, box: Box) -> None:
    """Adds the world's name and, below it, where it comes from."""
    area_m2 = sum(
        (room.floor.x_max_m - room.floor.x_min_m) * (room.floor.y_max_m - room.floor.y_min_m) for room in world.rooms
    )
    plural = "" if len(world.rooms) == 1 else "s"
    facts = (
        f"{len(world.rooms)} room{plural}, {area_m2:.1f} m² · ceiling {world.ceiling_height_m:.2f} m · "
        f"seed {world.seed} · {world.generation}"
    )
    name = fitted(world.name, _TITLE_SIZE, box.width)
    element(parent, "text", name, x=box.left, y=box.top + _TITLE_SIZE, font_size=_TITLE_SIZE, class_="name")
    shown = fitted(facts, _SUBTITLE_SIZE, box.width)
    element(parent, "text", shown, x=box.left, y=box.bottom, font_size=_SUBTITLE_SIZE, class_="quiet")


def draw_dimensions(parent: ET.Element, world: World, sheet: Sheet, offset: float) -> None:
    """Adds the outer dimensions of the building, above it and to its left, ``offset`` page units away."""
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


def draw_scale_bar(parent: ET.Element, sheet: Sheet, left: float, top: float, longest: float) -> None:
    """Adds a bar of four equal parts, as long as fits into ``longest`` page units."""
    fitting = [step_m for step_m in _SCALE_STEPS_M if 4 * step_m * sheet.units_per_m <= longest]
    part_m = max(fitting, default=_SCALE_STEPS_M[0])
    part = part_m * sheet.units_per_m
    group = element(parent, "g", class_="scale")
    for number in range(4):
        box = Box(left + number * part, top, left + (number + 1) * part, top + 6)
        rectangle(group, box, class_="dark" if number % 2 == 0 else "bright")
    for number in range(0, 5, 2):
        unit = " m" if number == 4 else ""
        text = f"{number * part_m:g}{unit}"
        element(group, "text", text, x=left + number * part, y=top + 22, font_size=_SMALL_SIZE, class_="tick")


def draw_north(parent: ET.Element, x: float, top: float) -> None:
    """Adds the north arrow: y is north and x is east, as ROS has it (REP 103)."""
    group = element(parent, "g", class_="north")
    element(group, "title", "North is +y, east is +x (REP 103)")
    element(group, "path", d=f"M{x:.2f} {top:.2f}l8 26l-8 -6l-8 6z")
    element(group, "text", "N, +y", x=x - 14, y=top + 18, font_size=_SMALL_SIZE, text_anchor="end")


def draw_certificate(parent: ET.Element, world: World, box: Box) -> None:
    """Adds what is guaranteed about the world, in one row, and below it the wishes that are not fulfilled."""
    certificate = world.certificate
    narrowest = f"{certificate.narrowest_passage_m:.2f} m" if world.passages else "none"
    facts = (
        (f"{certificate.origin_clear_radius_m:.2f} m", "clear around start"),
        (f"{certificate.reachable_robot_radius_m:.2f} m", "largest robot radius"),
        (narrowest, "narrowest passage"),
        (f"{100 * certificate.free_floor_share:.0f} %", "free floor"),
        (f"{100 * certificate.area_error_mean:.1f} %", "mean area error"),
        (f"{certificate.overlaps}", "overlaps"),
    )
    group = element(parent, "g", class_="certificate")
    element(group, "title", "Certificate: measured on the finished geometry")
    column = box.width / len(facts)
    for number, (value, meaning) in enumerate(facts):
        x = box.left + number * column
        element(group, "text", value, x=x, y=box.top + _VALUE_SIZE, font_size=_VALUE_SIZE, class_="name")
        element(group, "text", meaning, x=x, y=box.top + 34, font_size=_SMALL_SIZE, class_="quiet")
    for number, line in enumerate(wishes(certificate)):
        y = box.top + 62 + number * _WISH_LINE
        element(group, "text", fitted(line, _SMALL_SIZE, box.width), x=box.left, y=y, font_size=_SMALL_SIZE)


def certificate_height(certificate: Certificate) -> float:
    """Returns the page units that `draw_certificate` needs."""
    lines = len(wishes(certificate))
    return 36.0 + (lines * _WISH_LINE + 12.0 if lines else 0.0)


def wishes(certificate: Certificate) -> list[str]:
    """Returns the unmet wishes as lines, at most `MAX_WISHES` and then how many more."""
    lines = [f"Not fulfilled: {wish}" for wish in certificate.unmet[:MAX_WISHES]]
    more = len(certificate.unmet) - len(lines)
    return [*lines, f"and {more} more wishes not fulfilled"] if more else lines
