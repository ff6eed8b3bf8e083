"""Furniture on the plan: the tops of its solids, lowest first, and what it is, where that fits."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from specs.data.world import Furniture, Solid
from tasks.export.drawing.plan_page import (
    Attributes,
    PageBox,
    PageScale,
    corners_m,
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
    """Returns the pieces in the order in which they are drawn: what is higher covers what is lower."""
    return sorted(pieces, key=_height_m)


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
            _label(parent, piece, fit)
    return taken[len(occupied) :]


def piece_box(piece: Furniture, sheet: PageScale) -> PageBox:
    """Returns the page box around all solids of a piece."""
    return page_box(piece.solids, piece.center_m, sheet)


def in_words(model_type: str) -> str:
    """Returns one of what a type of model names: ``Washing machine and dryer`` for ``WashingMachinesAndDryers``."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|[_\s]+", " ", model_type).split()
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


def _label(parent: ET.Element, piece: Furniture, fit: _Fit) -> None:
    x, y = fit.place.center
    turn: Attributes = {"transform": f"rotate(-90 {x:.2f} {y:.2f})"} if fit.upright else {}
    ground = "dark" if _luma(_under_middle(piece)) < 0.45 else "light"
    baseline = y + 0.36 * fit.size
    element(parent, "text", fit.text, x=x, y=baseline, font_size=fit.size, class_=f"piece on-{ground}", **turn)


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
