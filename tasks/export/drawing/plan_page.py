"""The page that a floor plan is drawn on: metres to page units, elements, outlines of solids, and text that fits.

SVG 2 (W3C Candidate Recommendation 2018) counts y downwards, worlds count it upwards; `PageScale` is the one place
where it is turned. A page unit is a CSS pixel; the plan's longer side always takes the same number of them, so that
type and lines have one size whatever the apartment's.
"""

import math
import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from xml.etree import ElementTree as ET

from specs.data.world import Rectangle, Solid, corners_m

# What XML 1.0 (5th edition, production 2) does not allow in a document, escaped or not.
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
# Widths of a wide sans-serif face (DejaVu Sans, which browsers on Linux take): other faces are narrower.
_NARROW, _BROAD = frozenset("ijl.,:;'|!()[]ft r/-I·"), frozenset("mwMW@%—…")
_EM_NARROW, _EM_LOWER, _EM_UPPER, _EM_BROAD, _EM_FULL = 0.40, 0.62, 0.74, 1.0, 1.05
_WIDE = ("W", "F")

Attributes = dict[str, str | float]
"""Attributes of an element, by their Python names (`element`)."""


@dataclass(frozen=True)
class PageBox:
    """A rectangle in page units, y downwards."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def width(self) -> float:
        """Returns the extent along x."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Returns the extent along y."""
        return self.bottom - self.top

    @property
    def center(self) -> tuple[float, float]:
        """Returns the middle."""
        return (self.left + self.right) / 2, (self.top + self.bottom) / 2

    def overlap(self, other: "PageBox") -> float:
        """Returns the area that both cover."""
        width = min(self.right, other.right) - max(self.left, other.left)
        height = min(self.bottom, other.bottom) - max(self.top, other.top)
        return max(0.0, width) * max(0.0, height)

    def grown(self, margin: float) -> "PageBox":
        """Returns the box with every side moved outwards."""
        return PageBox(self.left - margin, self.top - margin, self.right + margin, self.bottom + margin)


@dataclass(frozen=True)
class PageScale:
    """Where the world lies on the page.

    Attributes:
        units_per_m: Page units a metre.
        left: Page x of the world's ``x_min_m``.
        top: Page y of the world's ``y_max_m``.
    """

    x_min_m: float
    y_max_m: float
    units_per_m: float
    left: float
    top: float

    def x(self, x_m: float) -> float:
        """Returns the page x of a world x."""
        return self.left + (x_m - self.x_min_m) * self.units_per_m

    def y(self, y_m: float) -> float:
        """Returns the page y of a world y."""
        return self.top + (self.y_max_m - y_m) * self.units_per_m

    def box(self, area: Rectangle) -> PageBox:
        """Returns the page box of a rectangle on the floor."""
        return PageBox(self.x(area.x_min_m), self.y(area.y_max_m), self.x(area.x_max_m), self.y(area.y_min_m))


def element(parent: ET.Element, tag: str, text: str = "", /, **attributes: str | float) -> ET.Element:
    """Returns a new child of ``parent``; ``stroke_width=2`` becomes ``stroke-width="2"``."""
    written = {key.rstrip("_").replace("_", "-"): written_as(value) for key, value in attributes.items()}
    child = ET.SubElement(parent, tag, written)
    if text:
        child.text = printable(text)
    return child


def rectangle(parent: ET.Element, box: PageBox, /, **attributes: str | float) -> ET.Element:
    """Returns a new ``rect`` over a page box."""
    return element(parent, "rect", "", x=box.left, y=box.top, width=box.width, height=box.height, **attributes)


def printable(text: str) -> str:
    """Returns the text with every character that XML forbids replaced by U+FFFD."""
    return _NOT_XML.sub("\ufffd", text)


def written_as(value: str | float) -> str:
    """Returns an attribute's value: text as it is but printable, numbers with at most two decimals."""
    if isinstance(value, str):
        return printable(value)
    # Adding zero makes the negative zero that rounding leaves a plain one.
    return f"{round(value, 2) + 0.0:.2f}".rstrip("0").rstrip(".")


def text_width(text: str, size: float) -> float:
    """Returns an estimate, rather too wide than too narrow, of a line's width in a sans-serif face of that size."""
    return size * sum(map(_ems, text))


def _ems(character: str) -> float:
    if character in _NARROW:
        return _EM_NARROW
    if character in _BROAD:
        return _EM_BROAD
    if unicodedata.east_asian_width(character) in _WIDE:
        return _EM_FULL
    return _EM_UPPER if character.isupper() else _EM_LOWER


def fit_text(text: str, size: float, width: float) -> str:
    """Returns the text, cut and ended with an ellipsis where it is wider than ``width``."""
    text = " ".join(text.split())
    if text_width(text, size) <= width:
        return text
    while text and text_width(text + "…", size) > width:
        text = text[:-1]
    return text.rstrip() + "…"


def css_color(color: tuple[float, float, float], towards_white: float = 0.0) -> str:
    """Returns ``#rrggbb`` of an sRGB colour, mixed with white by a share 0-1."""
    mixed = (channel + (1.0 - channel) * towards_white for channel in color)
    return "#" + "".join(f"{round(255 * min(1.0, max(0.0, channel))):02x}" for channel in mixed)


def draw_solid(parent: ET.Element, solid: Solid, sheet: PageScale, attributes: Attributes) -> None:
    """Adds the outline of a solid.

    Args:
        parent: What the outline becomes part of.
        solid: What is drawn.
        sheet: Where the world lies on the page.
        attributes: Of the SVG element.
    """
    x, y = sheet.x(solid.center_m[0]), sheet.y(solid.center_m[1])
    half_x, half_y = (half * sheet.units_per_m for half in solid.half_extents_m[:2])
    if solid.shape == "cylinder":
        element(parent, "circle", cx=x, cy=y, r=half_x, **attributes)
        return
    if solid.shape == "prism":
        corners = " ".join(f"{sheet.x(x_m):.2f},{sheet.y(y_m):.2f}" for x_m, y_m in corners_m(solid))
        element(parent, "polygon", points=corners, **attributes)
        return
    # Counter-clockwise with y up is negative with y down.
    turn: Attributes = (
        {"transform": f"rotate({-math.degrees(solid.yaw_rad):.3f} {x:.2f} {y:.2f})"} if solid.yaw_rad else {}
    )
    rectangle(parent, PageBox(x - half_x, y - half_y, x + half_x, y + half_y), **{**attributes, **turn})


def page_box(solids: Iterable[Solid], center_m: tuple[float, float], sheet: PageScale) -> PageBox:
    """Returns the page box around solids, or an empty one at ``center_m`` where there are none."""
    corners = [corner for solid in solids for corner in corners_m(solid)] or [center_m]
    xs, ys = [x for x, _ in corners], [y for _, y in corners]
    return PageBox(sheet.x(min(xs)), sheet.y(max(ys)), sheet.x(max(xs)), sheet.y(min(ys)))


def covers(solid: Solid, x_m: float, y_m: float) -> bool:
    """Returns whether a place on the floor is below a solid."""
    dx_m, dy_m = x_m - solid.center_m[0], y_m - solid.center_m[1]
    half_x_m, half_y_m, _ = solid.half_extents_m
    if solid.shape == "cylinder":
        return math.hypot(dx_m, dy_m) <= half_x_m
    if solid.shape == "prism":
        corners = corners_m(solid)
        sides = pairwise([*corners, corners[0]])
        return all((bx - ax) * (y_m - ay) >= (by - ay) * (x_m - ax) for (ax, ay), (bx, by) in sides)
    cos, sin = math.cos(solid.yaw_rad), math.sin(solid.yaw_rad)
    return abs(cos * dx_m + sin * dy_m) <= half_x_m and abs(cos * dy_m - sin * dx_m) <= half_y_m


def from_above(solids: Iterable[Solid]) -> list[Solid]:
    """Returns the solids that one sees from above, lowest first: those not wholly below a higher one."""
    ordered = sorted(solids, key=top_m)
    return [
        solid
        for number, solid in enumerate(ordered)
        if not any(all(covers(higher, *corner) for corner in corners_m(solid)) for higher in ordered[number + 1 :])
    ]


def top_m(solid: Solid) -> float:
    """Returns the height of a solid's upper face."""
    return solid.center_m[2] + solid.half_extents_m[2]


def bottom_m(solid: Solid) -> float:
    """Returns the height of a solid's lower face."""
    return solid.center_m[2] - solid.half_extents_m[2]
