"""A floor plan to look at: rooms, ways, furniture, start, and what is guaranteed, as one self-contained SVG."""

from xml.etree import ElementTree as ET

from specs.world import World
from tasks.export.plan_drawing import (
    draw_floors,
    draw_furniture,
    draw_passages,
    draw_patterns,
    draw_room_labels,
    draw_start,
    draw_walls,
)
from tasks.export.plan_legend import (
    certificate_height,
    draw_certificate,
    draw_dimensions,
    draw_north,
    draw_scale_bar,
    draw_title,
)
from tasks.export.plan_page import Box, Sheet, element

_PLAN_SIDE = 900.0  # page units of the plan's longer side
_MIN_INNER_WIDTH = 820.0  # the certificate's row needs it
_SIDE_MARGIN = 64.0  # the left one holds a dimension line
_MARGIN = 40.0
_TITLE_HEIGHT = 52.0
_DIMENSION_OFFSET = 18.0
_DIMENSION_SPACE = 46.0
_SCALE_SPACE = 58.0
_STYLE = """
svg{background:#fff;font-family:system-ui,"Segoe UI",Roboto,Helvetica,Arial,sans-serif;fill:#23272b}
.name{font-weight:600}.quiet{fill:#626b74}.threshold{fill:#d9d5cf}.joint{stroke:#000;stroke-opacity:.13;fill:none}
.wall{fill:#2b2f33;stroke:#2b2f33;stroke-width:.6}.low-wall{fill:#9aa0a6;stroke:#2b2f33;stroke-width:.6}
.lintel{fill:none;stroke:#2b2f33;stroke-width:.7;stroke-dasharray:4 3}
.gap{fill:#fff;fill-opacity:.45;stroke:none}
.furniture rect,.furniture circle{stroke:#1d2125;stroke-opacity:.75;stroke-width:.9}
.label text{text-anchor:middle;paint-order:stroke;stroke:#fff;stroke-linejoin:round;stroke-opacity:.8;stroke-width:3.5}
.piece{text-anchor:middle;paint-order:stroke;stroke-width:2;stroke-linejoin:round}
.on-dark{fill:#fff;stroke:#23272b;stroke-opacity:.3}.on-light{fill:#23272b;stroke:#fff;stroke-opacity:.85}
.start .clear{fill:#1769d2;fill-opacity:.07;stroke:#1769d2;stroke-width:1.2;stroke-dasharray:6 4}
.start .origin{fill:#1769d2}.start .mark{font-size:12px;fill:#1257b0}
.axis-x,.axis-y{fill:none;stroke-width:2}.axis-x{stroke:#c5221f}.axis-y{stroke:#188038}
.dimension path{fill:none;stroke:#626b74;stroke-width:1}.dimension text,.tick{text-anchor:middle;fill:#626b74}
.scale rect{stroke:#2b2f33;stroke-width:1}.dark{fill:#2b2f33}.bright{fill:#fff}.north path{fill:#2b2f33}
"""


def floor_plan_svg(world: World) -> str:
    """Returns the plan of a world, y up, as an SVG document; whatever the names, and the same for the same world."""
    footprint = world.footprint
    width_m, height_m = footprint.x_max_m - footprint.x_min_m, footprint.y_max_m - footprint.y_min_m
    units_per_m = _PLAN_SIDE / max(width_m, height_m)
    inner = max(_MIN_INNER_WIDTH, width_m * units_per_m)
    left, right = _SIDE_MARGIN, _SIDE_MARGIN + inner
    top = _MARGIN + _TITLE_HEIGHT + _DIMENSION_SPACE
    sheet = Sheet(footprint.x_min_m, footprint.y_max_m, units_per_m, left + (inner - width_m * units_per_m) / 2, top)
    below = top + height_m * units_per_m + 24
    facts = below + _SCALE_SPACE
    root = _root(world, Box(0, 0, right + left, facts + certificate_height(world.certificate) + _MARGIN))
    _say_scale(root, sheet)
    draw_patterns(element(root, "defs"), world, sheet)
    _plan(root, world, sheet)
    draw_title(root, world, Box(left, _MARGIN, right, _MARGIN + _TITLE_HEIGHT))
    draw_dimensions(root, world, sheet, _DIMENSION_OFFSET)
    draw_scale_bar(root, sheet, left, below, inner / 2)
    draw_north(root, right - 8, below)
    draw_certificate(root, world, Box(left, facts, right, facts))
    return ET.tostring(root, encoding="unicode") + "\n"


def _root(world: World, page: Box) -> ET.Element:
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
    names = ", ".join(f"{room.name} ({room.type})" for room in world.rooms)
    element(root, "desc", f"Rooms: {names}. {len(world.furniture)} pieces of furniture.", id="plan-description")
    element(root, "style", _STYLE)
    return root


def _say_scale(root: ET.Element, sheet: Sheet) -> None:
    """Writes down how metres became page units, for whoever draws on the plan later (a failed episode's path)."""
    root.set("data-units-per-m", f"{sheet.units_per_m:.6f}")
    root.set("data-origin-x", f"{sheet.x(0.0):.6f}")
    root.set("data-origin-y", f"{sheet.y(0.0):.6f}")


def _plan(root: ET.Element, world: World, sheet: Sheet) -> None:
    draw_floors(element(root, "g", class_="floors"), world, sheet)
    draw_passages(element(root, "g", class_="passages"), world, sheet)
    draw_furniture(element(root, "g", class_="pieces"), world.furniture, sheet)
    draw_walls(element(root, "g", class_="walls"), world.walls, sheet)
    draw_start(root, sheet)
    draw_room_labels(element(root, "g", class_="labels"), world, sheet)
