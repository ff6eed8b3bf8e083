"""Furniture as a drawing: on the plan with its name where that fits, and one thing alone, seen from three sides."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from specs.data.world import Furniture, Rectangle, Solid, below_heads, corners_m
from tasks.export.drawing.plan_page import (
    Attributes,
    PageBox,
    PageScale,
    bottom_m,
    covers,
    css_color,
    draw_solid,
    element,
    from_above,
    page_box,
    text_width,
    top_m,
)

_LABEL_SIZES = (10.5, 9.0)
_TOWARDS_WHITE, _OUTLINE_SHARE = 0.22, 0.42
_LABEL_MARGIN = 3.0


@dataclass(frozen=True)
class _Fit:
    """A text that fits onto a piece: how it is written, and its box on the page."""

    text: str
    size: float
    place: PageBox
    upright: bool


def draw_furniture(parent: ET.Element, pieces: Sequence[Furniture], sheet: PageScale) -> None:
    """Adds every piece, lower ones first, with its name as tooltip."""
    for piece in lowest_first(pieces):
        group = element(parent, "g", class_="furniture")
        element(group, "title", f"{piece.name}: {piece.model_type}, in {piece.room}")
        for solid in from_above(piece.solids):
            draw_solid(group, solid, sheet, solid_style(solid))


def lowest_first(pieces: Sequence[Furniture]) -> list[Furniture]:
    """Returns the pieces in the order in which they are drawn: what is higher covers what is lower, and no roof all."""
    return sorted(below_heads(pieces), key=_height_m)


def solid_style(solid: Solid) -> Attributes:
    """Returns the fill of a solid, and as its outline a darker tone of the same colour."""
    red, green, blue = (_OUTLINE_SHARE * channel for channel in solid.color)
    return {"fill": css_color(solid.color, _TOWARDS_WHITE), "stroke": css_color((red, green, blue))}


def draw_piece_labels(
    parent: ET.Element, pieces: Sequence[Furniture], sheet: PageScale, occupied: Sequence[PageBox]
) -> list[PageBox]:
    """Adds what each piece is, where it fits onto the piece and covers no other text; returns the boxes of the texts.

    Args:
        parent: Where to.
        pieces: The furniture.
        sheet: Where the world lies on the page.
        occupied: Boxes of texts that are there already.
    """
    taken = list(occupied)
    for piece in reversed(lowest_first(pieces)):
        fit = _fitting(in_words(piece.model_type), piece_box(piece, sheet), taken)
        if fit is not None:
            taken.append(fit.place)
            x, y = fit.place.center
            turn: Attributes = {"transform": f"rotate(-90 {x:.2f} {y:.2f})"} if fit.upright else {}
            ground = "dark" if _luma(_under_middle(piece)) < 0.45 else "light"
            baseline = y + 0.36 * fit.size
            element(parent, "text", fit.text, x=x, y=baseline, font_size=fit.size, class_=f"piece on-{ground}", **turn)
    return taken[len(occupied) :]


def piece_box(piece: Furniture, sheet: PageScale) -> PageBox:
    """Returns the page box around all solids of a piece."""
    return page_box(piece.solids, piece.center_m, sheet)


def in_words(model_type: str) -> str:
    """Returns one of what a type of model names: ``Washing machine and dryer`` for ``WashingMachinesAndDryers``.

    What somebody called a model of a world of his own is no plural.
    """
    if "_" in model_type:
        return " ".join(model_type.replace("_", " ").split())
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|\s+", " ", model_type).split()
    return " ".join([*(_singular(word) for word in words[:1]), *(_singular(word).lower() for word in words[1:])])


def _singular(word: str) -> str:
    if word.endswith("ches"):
        return word.removesuffix("es")
    return word.removesuffix("s") if not word.endswith("ss") else word


def _fitting(text: str, box: PageBox, taken: Sequence[PageBox]) -> _Fit | None:
    """Returns the longest form of a text that fits onto a piece, rather lying than upright."""
    first, _, last = text.partition(" and ")
    # "Sideboard" for "Sideboard and buffet"; but "End and side table" is no end.
    forms = [text, first] if last and " " not in last else [text]
    x, y = box.center
    for form in forms:
        for size in _LABEL_SIZES:
            half_x, half_y = text_width(form, size) / 2, size / 2
            lying, upright = (
                PageBox(x - half_x, y - half_y, x + half_x, y + half_y),
                PageBox(x - half_y, y - half_x, x + half_y, y + half_x),
            )
            for place in (lying, upright):
                fits = place.width + _LABEL_MARGIN <= box.width and place.height + _LABEL_MARGIN <= box.height
                if fits and not any(place.overlap(other) for other in taken):
                    return _Fit(form, size, place, upright=place is upright)
    return None


def _height_m(piece: Furniture) -> float:
    return max(map(top_m, piece.solids), default=0.0)


def _under_middle(piece: Furniture) -> Solid:
    """Returns the highest solid in the middle of a piece, where its text is; the highest of all where none is there."""
    corners = [corner for solid in piece.solids for corner in corners_m(solid)]
    middle_x_m, middle_y_m = ((min(axis) + max(axis)) / 2 for axis in zip(*corners, strict=True))
    there = [solid for solid in piece.solids if covers(solid, middle_x_m, middle_y_m)]
    return max(there or piece.solids, key=top_m)


def _luma(solid: Solid) -> float:
    """Returns how bright a solid is, 0-1 (ITU-R BT.709)."""
    red, green, blue = solid.color
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


UNITS_PER_M = 64.0
_TURN_RAD, _TILT_RAD = math.radians(32.0), math.radians(28.0)
# To the eye, on the floor: turned from the front (+y) towards +x.
_TO_EYE = (math.sin(_TURN_RAD), math.cos(_TURN_RAD))
_MARGIN = 8.0
_TOP_LIGHT, _FRONT_LIGHT, _SIDE_LIGHT = 1.06, 0.94, 0.78
_TOUCH_M = 1e-3
_STYLE = (
    "svg{background:#fff}path,ellipse{stroke-width:.7;stroke-linejoin:round}"
    ".clear{fill:none;stroke:#1769d2;stroke-dasharray:4 3}"
)

_Page = tuple[float, float]
_Span = tuple[float, float]


def solid_view_svg(title: str, solids: Sequence[Solid], clear: Rectangle | None = None) -> str:
    """Returns a picture of solids, all pictures at one scale.

    Args:
        title: What it shows.
        solids: What is drawn; their fronts face +y.
        clear: Floor that is kept free for it, drawn as a dashed outline.
    """
    floor = _floor_corners(clear) if clear else []
    points = [*floor, *(_project(x, y, z) for each in solids for x, y in corners_m(each) for z in _heights(each))]
    left, top = (min(point[axis] for point in points) - _MARGIN for axis in (0, 1))
    width, height = (max(point[axis] for point in points) + _MARGIN - least for axis, least in ((0, left), (1, top)))
    size = {"width": f"{width:.0f}", "height": f"{height:.0f}"}
    root = ET.Element(
        "svg", {"xmlns": "http://www.w3.org/2000/svg", "viewBox": f"0 0 {width:.0f} {height:.0f}", **size}
    )
    element(root, "title", title)
    element(root, "style", _STYLE)
    page = element(root, "g", "", transform=f"translate({-left:.1f} {-top:.1f})")
    if floor:
        element(page, "path", "", d=_outline(floor), class_="clear")
    for solid in _farthest_first(solids):
        _draw(page, solid)
    return ET.tostring(root, encoding="unicode") + "\n"


def _project(x: float, y: float, z: float) -> _Page:
    """Returns where a point lies on the page, y downwards."""
    across = -math.cos(_TURN_RAD) * x + math.sin(_TURN_RAD) * y
    near = _TO_EYE[0] * x + _TO_EYE[1] * y
    return UNITS_PER_M * across, UNITS_PER_M * (near * math.sin(_TILT_RAD) - z * math.cos(_TILT_RAD))


def _floor_corners(area: Rectangle) -> list[_Page]:
    xs, ys = (area.x_min_m, area.x_max_m), (area.y_min_m, area.y_max_m)
    return [_project(x, y, 0.0) for x, y in ((xs[0], ys[0]), (xs[1], ys[0]), (xs[1], ys[1]), (xs[0], ys[1]))]


def _heights(solid: Solid) -> _Span:
    return bottom_m(solid), top_m(solid)


def _draw(parent: ET.Element, solid: Solid) -> None:
    if solid.shape == "cylinder":
        _draw_cylinder(parent, solid)
        return
    corners, (low, high) = corners_m(solid), _heights(solid)
    for number, (one, other) in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True)):
        normal = (other[1] - one[1], one[0] - other[0])  # outwards, as the corners run counter-clockwise
        if normal[0] * _TO_EYE[0] + normal[1] * _TO_EYE[1] > 0:
            face = [_project(*one, low), _project(*other, low), _project(*other, high), _project(*one, high)]
            _face(parent, solid, face, _FRONT_LIGHT if number % 2 == 0 else _SIDE_LIGHT)
    _face(parent, solid, [_project(x, y, high) for x, y in corners], _TOP_LIGHT)


def _draw_cylinder(parent: ET.Element, solid: Solid) -> None:
    x, y, _ = solid.center_m
    (left, low), (_, high) = (_project(x, y, z) for z in _heights(solid))
    radius = UNITS_PER_M * solid.half_extents_m[0]
    flat = radius * math.sin(_TILT_RAD)
    right = left + radius
    arc = f"A{radius:.1f} {flat:.1f} 0 0 0 {right:.1f} {low:.1f}"
    wall = f"M{left - radius:.1f} {high:.1f}V{low:.1f}{arc}V{high:.1f}Z"
    element(parent, "path", "", d=wall, **_paint(solid, (_FRONT_LIGHT + _SIDE_LIGHT) / 2))
    element(parent, "ellipse", "", cx=left, cy=high, rx=radius, ry=flat, **_paint(solid, _TOP_LIGHT))


def _face(parent: ET.Element, solid: Solid, face: Sequence[_Page], light: float) -> None:
    element(parent, "path", "", d=_outline(face), **_paint(solid, light))


def _outline(points: Sequence[_Page]) -> str:
    return f"M{'L'.join(f'{x:.1f} {y:.1f}' for x, y in points)}Z"


def _paint(solid: Solid, light: float) -> dict[str, str | float]:
    red, green, blue = (min(1.0, light * channel) for channel in solid.color)
    edge = (0.55 * red, 0.55 * green, 0.55 * blue)
    return {"fill": css_color((red, green, blue)), "stroke": css_color(edge)}


def _farthest_first(solids: Sequence[Solid]) -> list[Solid]:
    """Returns solids such that none is drawn over one that hides it.

    Of two that a plane parts, the one on the eye's side hides the other. A ring of such pairs is cut at the solid that
    is farthest.
    """
    left, ordered = sorted(solids, key=_nearness), list[Solid]()
    while left:
        free = (each for each in left if not any(_hides(each, other) for other in left if other is not each))
        ordered.append(next(free, left[0]))
        left = [each for each in left if each is not ordered[-1]]
    return ordered


def _hides(solid: Solid, other: Solid) -> bool:
    """Returns whether a solid lies before another on some axis, and behind it on none."""
    before = behind = False
    for (low, high), (other_low, other_high) in zip(_spans(solid), _spans(other), strict=True):
        before = before or low >= other_high - _TOUCH_M
        behind = behind or high <= other_low + _TOUCH_M
    return before and not behind


def _spans(solid: Solid) -> tuple[_Span, _Span, _Span]:
    """Returns from where to where a solid reaches along each axis; the eye is at the upper end of all three."""
    corners = corners_m(solid)
    xs, ys = [x for x, _ in corners], [y for _, y in corners]
    return (min(xs), max(xs)), (min(ys), max(ys)), _heights(solid)


def _nearness(solid: Solid) -> float:
    x, y, z = solid.center_m
    return math.cos(_TILT_RAD) * (_TO_EYE[0] * x + _TO_EYE[1] * y) + math.sin(_TILT_RAD) * z
