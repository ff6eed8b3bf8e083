"""A floor plan to look at: rooms, ways, furniture, start, and what is guaranteed, as one self-contained SVG.

Around the plan stand title, dimensions, scale bar, floorings and north; below it the certificate with what became of
every wish of the template.
"""

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from specs.data.world import Certificate, Room, Wish, World
from tasks.export.drawing.building_plan import (
    draw_doors,
    draw_floors,
    draw_passages,
    draw_patterns,
    draw_room_labels,
    draw_start,
    draw_walls,
    draw_windows,
    draw_zones,
    floor_color,
    floor_m2,
    pattern_key,
)
from tasks.export.drawing.furniture_symbols import draw_furniture, draw_piece_labels
from tasks.export.drawing.plan_page import PageBox, PageScale, element, fit_text, rectangle, text_width

_TITLE_SIZE, _SUBTITLE_SIZE, _SMALL_SIZE, _SWATCH_SIZE = 26.0, 14.0, 12.0, 11.0
_TICK = 5.0
_SCALE_STEPS_M = (0.5, 1.0, 2.0, 5.0, 10.0)
_SWATCH = PageBox(0.0, 0.0, 22.0, 14.0)


def draw_title(parent: ET.Element, world: World, box: PageBox) -> None:
    """Adds the world's name and, below it, where it comes from."""
    source, plural = world.source, "" if len(world.rooms) == 1 else "s"
    rooms = f"{len(world.rooms)} room{plural}, " if world.rooms else "free floor "
    made = f"seed {world.seed} · {world.generation}" if source is None else f"{source.file} · {world.generation}"
    facts = f"{rooms}{floor_m2(world):.1f} m² · ceiling {world.ceiling_height_m:.2f} m · {made}"
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


MAX_WISHES = 28
_VALUE_SIZE, _MEANING_SIZE, _HEADING_SIZE, _WISH_SIZE = 18.0, 10.5, 12.5, 11.0
_FACTS_HEIGHT, _HEADING_HEIGHT, _WISH_LINE, _GAP = 62.0, 26.0, 17.0, 28.0
_MARK_WIDTH, _SUBJECT_SHARE = 16.0, 0.37


def draw_certificate(parent: ET.Element, world: World, box: PageBox) -> None:
    """Adds the figures in one row, and below it the wishes in two columns, those not fulfilled first."""
    certificate = world.certificate
    group = element(parent, "g", class_="certificate")
    element(group, "title", "Certificate: measured on the finished geometry")
    element(group, "path", d=f"M{box.left:.2f} {box.top:.2f}H{box.right:.2f}", class_="rule")
    facts = _facts(world)
    column = box.width / len(facts)
    for number, (value, meaning) in enumerate(facts):
        x = box.left + number * column
        element(group, "text", value, x=x, y=box.top + 28, font_size=_VALUE_SIZE, class_="name")
        shown = fit_text(meaning, _MEANING_SIZE, column - 4)
        element(group, "text", shown, x=x, y=box.top + 44, font_size=_MEANING_SIZE, class_="quiet")
    if certificate.wishes:
        _wishes(group, certificate, PageBox(box.left, box.top + _FACTS_HEIGHT, box.right, box.bottom))


def certificate_height(certificate: Certificate) -> float:
    """Returns the page units that `draw_certificate` needs."""
    if not certificate.wishes:
        return _FACTS_HEIGHT
    return _FACTS_HEIGHT + _HEADING_HEIGHT + _rows(len(_shown(certificate))) * _WISH_LINE + 8.0


def wishes_met(certificate: Certificate) -> str:
    """Returns how many of the template's wishes the world fulfils, as a sentence without its end."""
    wishes = certificate.wishes
    met = sum(wish.met for wish in wishes)
    if not wishes:
        return "no wishes"
    return f"all {met} wishes fulfilled" if met == len(wishes) else f"{met} of {len(wishes)} wishes fulfilled"


def _facts(world: World) -> list[tuple[str, str]]:
    certificate = world.certificate
    as_set = (f"{certificate.doors_as_set_robot_radius_m:.2f} m", "doors as they stand")
    passage = (f"{certificate.narrowest_passage_m:.2f} m" if world.passages else "none", "narrowest passage")
    return [
        (f"{certificate.origin_clear_radius_m:.2f} m", "clear around start"),
        (f"{certificate.reachable_robot_radius_m:.2f} m", "largest robot radius"),
        *([as_set] if world.doors else []),
        *([] if world.source else [passage]),
        (f"{100 * certificate.free_floor_share:.0f} %", "free floor"),
        *([] if world.source else [(f"{100 * certificate.area_error_mean:.1f} %", "mean area error")]),
        (f"{certificate.overlaps}", "overlaps"),
    ]


def _wishes(parent: ET.Element, certificate: Certificate, box: PageBox) -> None:
    heading = wishes_met(certificate)
    y = box.top + _HEADING_SIZE
    element(parent, "text", heading[0].upper() + heading[1:], x=box.left, y=y, font_size=_HEADING_SIZE, class_="name")
    lines = _shown(certificate)
    rows = _rows(len(lines))
    width = (box.width - _GAP) / 2
    for number, line in enumerate(lines):
        x = box.left + number // rows * (width + _GAP)
        y = box.top + _HEADING_HEIGHT + (number % rows) * _WISH_LINE + _WISH_SIZE
        if isinstance(line, str):
            element(parent, "text", line, x=x + _MARK_WIDTH, y=y, font_size=_WISH_SIZE, class_="quiet")
        else:
            _wish(parent, line, PageBox(x, y - _WISH_SIZE, x + width, y))


def _wish(parent: ET.Element, wish: Wish, box: PageBox) -> None:
    group = element(parent, "g", class_="wish met" if wish.met else "wish unmet")
    came = wish.found if wish.found == wish.wished else f"{wish.found} (wished {wish.wished})"
    came = came.replace(" m2", " m²")
    element(group, "title", f"{_name(wish)}{_kind(wish)}: {came}")
    mark = "l3 3.2l5.4 -7" if wish.met else "m0.6 -3.4l7 7m0 -7l-7 7"
    element(group, "path", d=f"M{box.left:.2f} {box.bottom - 4:.2f}{mark}", class_="mark")
    width = box.width - _MARK_WIDTH
    x = box.left + _MARK_WIDTH
    # What is cut is the name of a room, not what was wished of it.
    kind = _kind(wish)
    name = fit_text(_name(wish), _WISH_SIZE, _SUBJECT_SHARE * width - 6 - text_width(kind, _WISH_SIZE))
    element(group, "text", name + kind, x=x, y=box.bottom, font_size=_WISH_SIZE)
    shown = fit_text(came, _WISH_SIZE, (1 - _SUBJECT_SHARE) * width)
    element(group, "text", shown, x=x + _SUBJECT_SHARE * width, y=box.bottom, font_size=_WISH_SIZE, class_="quiet")


def _name(wish: Wish) -> str:
    return wish.kind.capitalize() if wish.kind == "footprint" else wish.subject


def _kind(wish: Wish) -> str:
    """Returns what was wished of the subject; a pair of rooms says enough of a connection."""
    return "" if wish.kind in ("footprint", "connection") else f", {wish.kind}"


def _shown(certificate: Certificate) -> Sequence[Wish | str]:
    """Returns the wishes, those not fulfilled first, and instead of the last ones how many more there are."""
    ordered = [
        *(wish for wish in certificate.wishes if not wish.met),
        *(wish for wish in certificate.wishes if wish.met),
    ]
    if len(ordered) <= MAX_WISHES:
        return ordered
    rest = ordered[MAX_WISHES - 1 :]
    unmet = sum(not wish.met for wish in rest)
    more = f"and {len(rest)} more" + (f", {unmet} of them not fulfilled" if unmet else ", fulfilled")
    return [*ordered[: MAX_WISHES - 1], more]


def _rows(count: int) -> int:
    return -(-count // 2)


_PLAN_SIDE = 900.0  # page units of the plan's longer side, of apartments that are no closet
_MOST_UNITS_PER_M = 150.0
_MIN_INNER_WIDTH = 860.0  # the certificate's row needs it
_SIDE_MARGIN = 64.0  # the left one holds a dimension line
_MARGIN = 40.0
_TITLE_HEIGHT = 52.0
_DIMENSION_OFFSET = 18.0
_DIMENSION_SPACE = 46.0
_SCALE_SPACE = 52.0
_NORTH_SPACE = 50.0
PLAN_STYLE = """
svg{background:#fff;font-family:system-ui,"Segoe UI",Roboto,Helvetica,Arial,sans-serif;fill:#23272b}
.name{font-weight:600}.quiet{fill:#5f6870}.threshold{fill:#dedad4}.joint{stroke-opacity:.75;stroke-width:.6;fill:none}
.wall{fill:#2b2f33;stroke:#2b2f33;stroke-width:.6}.low-wall{fill:#9aa0a6;stroke:#2b2f33;stroke-width:.6}
.lintel{fill:none;stroke:#2b2f33;stroke-opacity:.6;stroke-width:.6;stroke-dasharray:3 3}
.gap{fill:#fff;fill-opacity:.35;stroke:none}
.swing{fill:#fff;fill-opacity:.35;stroke:#2b2f33;stroke-width:.7}
.leaf{fill:#fff;stroke:#2b2f33;stroke-width:1.1}
.pane{fill:#fff;stroke:#2b2f33;stroke-width:1}.glass{stroke:#3a7ca8;stroke-width:1.4}
.furniture{stroke-width:.8;stroke-linejoin:round}
.label text{text-anchor:middle;paint-order:stroke;stroke:#fff;stroke-linejoin:round;stroke-opacity:.8;stroke-width:3.5}
.piece{text-anchor:middle;paint-order:stroke;stroke-width:2;stroke-linejoin:round}
.on-dark{fill:#fff;stroke:#23272b;stroke-opacity:.3}.on-light{fill:#23272b;stroke:#fff;stroke-opacity:.85}
.start .clear{fill:#1769d2;fill-opacity:.06;stroke:#1769d2;stroke-width:1.2;stroke-dasharray:6 4}
.start .origin{fill:#1769d2}.start .mark{fill:#1257b0}
.axis-x,.axis-y{fill:none;stroke-width:2}.axis-x{stroke:#c5221f}.axis-y{stroke:#188038}
.dimension path,.north .ring,.rule{fill:none;stroke:#7a828a;stroke-width:1}
.dimension text,.tick{text-anchor:middle;fill:#5f6870}
.scale rect,.swatch{stroke:#2b2f33;stroke-width:.8}.dark{fill:#2b2f33}.bright{fill:#fff}.north path{fill:#2b2f33}
.wish .mark{fill:none;stroke-width:1.8;stroke-linecap:round}.met .mark{stroke:#188038}.unmet .mark{stroke:#c5221f}
"""


def floor_plan_svg(world: World) -> str:
    """Returns the plan of a world, y up, as an SVG document; whatever the names, and the same for the same world."""
    footprint = world.footprint
    width_m, height_m = footprint.x_max_m - footprint.x_min_m, footprint.y_max_m - footprint.y_min_m
    units_per_m = min(_MOST_UNITS_PER_M, _PLAN_SIDE / max(width_m, height_m))
    inner = max(_MIN_INNER_WIDTH, width_m * units_per_m)
    left, right = _SIDE_MARGIN, _SIDE_MARGIN + inner
    top = _MARGIN + _TITLE_HEIGHT + _DIMENSION_SPACE
    sheet = PageScale(
        footprint.x_min_m, footprint.y_max_m, units_per_m, left + (inner - width_m * units_per_m) / 2, top
    )
    below = top + height_m * units_per_m + 26
    facts = below + _SCALE_SPACE
    root = _root(world, PageBox(0, 0, right + left, facts + certificate_height(world.certificate) + _MARGIN))
    _say_scale(root, sheet)
    draw_patterns(element(root, "defs"), world, sheet)
    _plan(root, world, sheet)
    draw_title(root, world, PageBox(left, _MARGIN, right, _MARGIN + _TITLE_HEIGHT))
    draw_dimensions(root, world, sheet, _DIMENSION_OFFSET)
    bar_end = draw_scale_bar(root, sheet, left, below, inner / 2)
    draw_floorings(root, world, sheet, PageBox(bar_end + 40, below, right - _NORTH_SPACE, below))
    draw_north(root, right - 16, below)
    draw_certificate(root, world, PageBox(left, facts, right, facts))
    return ET.tostring(root, encoding="unicode") + "\n"


def _root(world: World, page: PageBox) -> ET.Element:
    root = ET.Element(
        "svg",
        {
            "xmlns": "http://www.w3.org/2000/svg",
            "viewBox": f"0 0 {page.width:.0f} {page.height:.0f}",
            "width": f"{page.width:.0f}",
            "height": f"{page.height:.0f}",
            "role": "img",
            "aria-labelledby": "plan-title plan-description",
        },
    )
    element(root, "title", f"Floor plan of {world.name}", id="plan-title")
    names = ", ".join(f"{each.name} ({each.type})" if isinstance(each, Room) else each.name for each in world.areas)
    element(
        root, "desc", f"Rooms: {names or 'none'}. {len(world.furniture)} pieces of furniture.", id="plan-description"
    )
    element(root, "style", PLAN_STYLE)
    return root


def _say_scale(root: ET.Element, sheet: PageScale) -> None:
    """Writes down how metres became page units, for whoever draws on the plan later (a failed episode's path)."""
    root.set("data-units-per-m", f"{sheet.units_per_m:.6f}")
    root.set("data-origin-x", f"{sheet.x(0.0):.6f}")
    root.set("data-origin-y", f"{sheet.y(0.0):.6f}")


def _plan(root: ET.Element, world: World, sheet: PageScale) -> None:
    draw_floors(element(root, "g", class_="floors"), world, sheet)
    draw_passages(element(root, "g", class_="passages"), world, sheet)
    draw_furniture(element(root, "g", class_="pieces"), world.furniture, sheet)
    draw_walls(element(root, "g", class_="walls"), world.walls, sheet)
    draw_windows(element(root, "g", class_="windows"), world, sheet)
    draw_doors(element(root, "g", class_="doors"), world, sheet)
    if world.zones:
        draw_zones(element(root, "g", class_="zones"), world, sheet)
    texts = [draw_start(root, world, sheet)]
    texts += draw_room_labels(element(root, "g", class_="labels"), world, sheet)
    draw_piece_labels(element(root, "g", class_="piece-labels"), world.furniture, sheet, texts)
