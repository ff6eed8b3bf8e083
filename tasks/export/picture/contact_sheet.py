"""The worlds of a job on one sheet: small plans at one scale, each with what its certificate comes to."""

from collections.abc import Iterable, Sequence
from itertools import islice
from xml.etree import ElementTree as ET

from specs.data.world import Certificate, Rectangle, World, start_pose
from tasks.export.drawing.building_plan import (
    START_RADIUS_M,
    draw_doors,
    draw_passages,
    draw_walls,
    draw_windows,
    draw_zone_outline,
    floor_color,
    floor_m2,
    free_at_start_m,
)
from tasks.export.drawing.floor_plan import PLAN_STYLE, draw_scale_bar
from tasks.export.drawing.furniture_symbols import lowest_first, piece_box, solid_style
from tasks.export.drawing.plan_page import (
    PageBox,
    PageScale,
    draw_solid,
    element,
    fit_text,
    from_above,
    rectangle,
    text_width,
)

MOST_WORLDS = 60
_PLAN_SIDE = 236.0  # page units of the longest side of the largest plan
_MARGIN, _GAP, _HEADER_HEIGHT, _FOOTER_HEIGHT = 44.0, 34.0, 84.0, 62.0
_CAPTION_HEIGHT = 60.0
_TITLE_SIZE, _SUBTITLE_SIZE, _NAME_SIZE, _FACT_SIZE, _ROOM_SIZE = 26.0, 14.0, 13.0, 10.5, 8.5
_SMALLEST_M2 = 0.01  # a door handle is less than a pixel
_STYLE = """
.unkept{fill:#8f5a00}.kept{fill:#188038}.room-name{text-anchor:middle;paint-order:stroke;stroke:#fff;stroke-width:2}
.plan .furniture,.plan .leaf,.plan .swing,.plan .pane{stroke-width:.5}.plan .wall,.plan .lintel{stroke-width:.3}
.plan .glass{stroke-width:.7}.plan .clear{fill:#1769d2;fill-opacity:.08;stroke:#1769d2;stroke-width:.6}
.plan .origin{fill:#1769d2}
"""


def contact_sheet_svg(worlds: Iterable[World], *, title: str, total: int | None = None, most: int = MOST_WORLDS) -> str:
    """Returns the first worlds on one sheet, as an SVG document, in bounded memory.

    Args:
        worlds: At least one.
        title: What they have in common, such as the name of their job.
        total: How many worlds there are; None counts those that are given.
        most: How many of them are kept, and drawn.

    Raises:
        ValueError: There are no worlds.
    """
    remaining = iter(worlds)
    shown = list(islice(remaining, most))
    if not shown:
        raise ValueError("a contact sheet needs a world")
    count = len(shown) + sum(1 for _ in remaining) if total is None else total
    grid = _Grid(shown)
    root = _root(grid, title, count)
    _header(root, shown, title, count, grid.width)
    for number, world in enumerate(shown):
        _cell(root, world, grid.cell(number), grid.units_per_m)
    bar = PageScale(0.0, 0.0, grid.units_per_m, 0.0, 0.0)
    draw_scale_bar(root, bar, _MARGIN, grid.height - _FOOTER_HEIGHT + 8, _PLAN_SIDE)
    return ET.tostring(root, encoding="unicode") + "\n"


class _Grid:
    """Where the cells of a sheet are: about as many across as fit a wide page, all at one scale."""

    def __init__(self, worlds: Sequence[World]) -> None:
        widths_m = [world.footprint.x_max_m - world.footprint.x_min_m for world in worlds]
        heights_m = [world.footprint.y_max_m - world.footprint.y_min_m for world in worlds]
        self.units_per_m = _PLAN_SIDE / max(*widths_m, *heights_m)
        self.columns = min(len(worlds), max(3, round((1.6 * len(worlds)) ** 0.5)))
        self._plan_height = max(heights_m) * self.units_per_m
        rows = -(-len(worlds) // self.columns)
        self.width = 2 * _MARGIN + self.columns * (_PLAN_SIDE + _GAP) - _GAP
        self.height = _HEADER_HEIGHT + _MARGIN + rows * self._step + _FOOTER_HEIGHT

    @property
    def _step(self) -> float:
        return self._plan_height + _CAPTION_HEIGHT + _GAP / 2

    def cell(self, number: int) -> PageBox:
        """Returns the page box of a cell's plan."""
        row, column = divmod(number, self.columns)
        left = _MARGIN + column * (_PLAN_SIDE + _GAP)
        top = _HEADER_HEIGHT + _MARGIN + row * self._step
        return PageBox(left, top, left + _PLAN_SIDE, top + self._plan_height)


def _root(grid: _Grid, title: str, count: int) -> ET.Element:
    width, height = f"{grid.width:.0f}", f"{grid.height:.0f}"
    attributes = {"viewBox": f"0 0 {width} {height}", "width": width, "height": height, "role": "img"}
    root = ET.Element("svg", {"xmlns": "http://www.w3.org/2000/svg", **attributes})
    element(root, "title", f"Contact sheet of {count} worlds: {title}")
    element(root, "style", PLAN_STYLE + _STYLE)
    return root


def _header(root: ET.Element, worlds: Sequence[World], title: str, count: int, width: float) -> None:
    inner = width - 2 * _MARGIN
    heading = fit_text(title, _TITLE_SIZE, inner)
    element(root, "text", heading, x=_MARGIN, y=_MARGIN + 20, font_size=_TITLE_SIZE, class_="name")
    facts = fit_text(summary(worlds, count), _SUBTITLE_SIZE, inner)
    element(root, "text", facts, x=_MARGIN, y=_MARGIN + 46, font_size=_SUBTITLE_SIZE, class_="quiet")


def summary(worlds: Sequence[World], count: int) -> str:
    """Returns what the worlds on a sheet have in common, in one line."""
    certificates = [world.certificate for world in worlds]
    areas_m2 = [floor_m2(world) for world in worlds]
    wishes = [wish for certificate in certificates for wish in certificate.wishes]
    plural = "" if count == 1 else "s"
    parts = [f"{count} world{plural}" if count == len(worlds) else f"the first {len(worlds)} of {count} worlds"]
    smallest, largest = f"{min(areas_m2):.0f}", f"{max(areas_m2):.0f}"
    parts.append(f"{smallest} m²" if smallest == largest else f"{smallest} to {largest} m²")
    radius_m = min(certificate.reachable_robot_radius_m for certificate in certificates)
    what = "every room" if all(world.rooms for world in worlds) else "the floor"
    parts.append(f"{what} within reach of a robot of {radius_m:.2f} m radius")
    as_set_m = min(certificate.doors_as_set_robot_radius_m for certificate in certificates)
    if as_set_m < radius_m:
        parts.append(f"with doors as set: up to {as_set_m:.2f} m")
    free = sum(certificate.free_floor_share for certificate in certificates) / len(certificates)
    parts.append(f"{100 * free:.0f} % free floor")
    if wishes:
        parts.append(f"{sum(wish.met for wish in wishes)} of {len(wishes)} wishes fulfilled")
    return " · ".join(parts)


def wishes_kept(certificate: Certificate) -> str:
    """Returns what became of a world's wishes, in a few words."""
    wishes = len(certificate.wishes)
    if not wishes:
        return "no wishes"
    unmet = len(certificate.unmet)
    return f"{unmet} of {wishes} wishes not fulfilled" if unmet else "every wish fulfilled"


def _cell(root: ET.Element, world: World, box: PageBox, units_per_m: float) -> None:
    area = world.footprint
    height = (area.y_max_m - area.y_min_m) * units_per_m
    group = element(root, "g", class_="plan")
    element(group, "title", world.name)
    _miniature(group, world, PageScale(area.x_min_m, area.y_max_m, units_per_m, box.left, box.bottom - height))
    _caption(root, world, box)


def _miniature(parent: ET.Element, world: World, sheet: PageScale) -> None:
    rectangle(parent, sheet.box(world.footprint), class_="threshold")
    for room in world.rooms:
        rectangle(parent, sheet.box(room.floor), fill=floor_color(room.flooring))
    draw_passages(parent, world, sheet)
    furniture = element(parent, "g", class_="furniture")
    for piece in lowest_first(world.furniture):
        for solid in from_above(piece.solids):
            if 4 * solid.half_extents_m[0] * solid.half_extents_m[1] >= _SMALLEST_M2:
                draw_solid(furniture, solid, sheet, solid_style(solid))
    draw_walls(parent, world.walls, sheet)
    draw_windows(parent, world, sheet)
    draw_doors(parent, world, sheet)
    start = start_pose(world)
    x, y = sheet.x(start.x_m), sheet.y(start.y_m)
    element(parent, "circle", cx=x, cy=y, r=free_at_start_m(world) * sheet.units_per_m, class_="clear")
    element(parent, "circle", cx=x, cy=y, r=1.6, class_="origin")
    for zone in world.zones or ():
        draw_zone_outline(parent, zone, sheet, dashes="3 2")
    _room_names(parent, world, sheet)


def _room_names(parent: ET.Element, world: World, sheet: PageScale) -> None:
    """Adds the name of every room that has the width for it, where it covers least furniture."""
    pose, reach = start_pose(world), START_RADIUS_M
    low, high = (pose.x_m - reach, pose.y_m - reach), (pose.x_m + reach, pose.y_m + reach)
    start = sheet.box(Rectangle(x_min_m=low[0], y_min_m=low[1], x_max_m=high[0], y_max_m=high[1]))
    for room in world.areas:
        inner = sheet.box(room.floor).grown(-3.0)
        width = text_width(room.name, _ROOM_SIZE)
        if width > inner.width or inner.height < _ROOM_SIZE:
            continue
        obstacles = [start, *(piece_box(piece, sheet) for piece in world.furniture if piece.room == room.name)]
        places = [
            _place(inner, width, across, down) for down in (0.5, 0.25, 0.75, 0.0, 1.0) for across in (0.5, 0.0, 1.0)
        ]
        x, y = min(places, key=lambda place: round(sum(place.overlap(other) for other in obstacles), 3)).center
        element(parent, "text", room.name, x=x, y=y + 3, font_size=_ROOM_SIZE, class_="room-name")


def _place(inner: PageBox, width: float, across: float, down: float) -> PageBox:
    """Returns the box of a line of text at shares 0-1 of the space that it leaves in a room."""
    left = inner.left + across * (inner.width - width)
    top = inner.top + down * (inner.height - _ROOM_SIZE)
    return PageBox(left, top, left + width, top + _ROOM_SIZE)


def _caption(root: ET.Element, world: World, box: PageBox) -> None:
    certificate = world.certificate
    facts = (
        f"{floor_m2(world):.1f} m² · {100 * certificate.free_floor_share:.0f} % free · "
        f"robot up to {certificate.reachable_robot_radius_m:.2f} m"
    )
    name = fit_text(world.name, _NAME_SIZE, box.width)
    element(root, "text", name, x=box.left, y=box.bottom + 19, font_size=_NAME_SIZE, class_="name")
    shown = fit_text(facts, _FACT_SIZE, box.width)
    element(root, "text", shown, x=box.left, y=box.bottom + 35, font_size=_FACT_SIZE, class_="quiet")
    if certificate.wishes:
        kept = "unkept" if certificate.unmet else "kept"
        element(
            root, "text", wishes_kept(certificate), x=box.left, y=box.bottom + 50, font_size=_FACT_SIZE, class_=kept
        )
