"""A floor plan to look at: rooms, ways, furniture, start, and what is guaranteed, as one self-contained SVG."""

from xml.etree import ElementTree as ET

from specs.data.world import World
from tasks.export.drawing.certificate_panel import certificate_height, draw_certificate
from tasks.export.drawing.door_symbols import draw_doors, draw_passages, draw_windows
from tasks.export.drawing.floor_patterns import draw_floors, draw_patterns
from tasks.export.drawing.furniture_outlines import draw_furniture, draw_piece_labels
from tasks.export.drawing.legend import draw_dimensions, draw_floorings, draw_north, draw_scale_bar, draw_title
from tasks.export.drawing.plan_page import PageBox, PageScale, element
from tasks.export.drawing.wall_section import draw_room_labels, draw_start, draw_walls

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
    names = ", ".join(f"{room.name} ({room.type})" for room in world.rooms)
    element(root, "desc", f"Rooms: {names}. {len(world.furniture)} pieces of furniture.", id="plan-description")
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
    texts = [draw_start(root, sheet)]
    texts += draw_room_labels(element(root, "g", class_="labels"), world, sheet)
    draw_piece_labels(element(root, "g", class_="piece-labels"), world.furniture, sheet, texts)
