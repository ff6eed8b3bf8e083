"""`simyard world furniture`: every kind of furniture with its sizes, its floor and its rooms, and a picture of each."""

from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import numpy as np
from pydantic import JsonValue

from specs.base import Fault, Spec
from specs.data.world import Rectangle, RoomType, Solid
from specs.errors import DocumentError
from specs.template.interior import ModelType
from tasks.export.drawing.solid_view import solid_view_svg
from tasks.worlds.furnishing.assembly import assemble, draw_look
from tasks.worlds.furnishing.scene import Piece
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.furniture.furniture_type import FurnitureType, Tier
from tasks.worlds.furniture.primitives import Range, Size
from tasks.worlds.geometry.boxes import Box

KINDS: tuple[str, ...] = get_args(ModelType)
_USUAL_ROOM_M2 = 20.0
_LOOK_SEED = 3
_TIERS: tuple[Tier, ...] = get_args(Tier)
_STANDS = {"wall": "at a wall", "corner": "in a corner", "center": "in the middle, at a wall in small rooms"}


class FurnitureKind(Spec):
    """One kind of furniture.

    Attributes:
        width_m: Least and greatest extent along its back.
        depth_m: Least and greatest extent from its back to its front.
        height_m: Least and greatest height.
        clear_m: Floor kept free before it.
        stands: Where it stands, alone or with what.
        essential: The rooms that it makes what they are.
        likely: Other rooms that mostly have it.
        occasional: Other rooms that sometimes have it.
    """

    kind: str
    width_m: Range
    depth_m: Range
    height_m: Range
    clear_m: float
    stands: str
    essential: tuple[RoomType, ...]
    likely: tuple[RoomType, ...]
    occasional: tuple[RoomType, ...]


def furniture_kinds() -> list[FurnitureKind]:
    """Returns every kind of furniture that a template may list, in the order of its schema."""
    return [_kind(CATALOGUE[name]) for name in KINDS]


def furniture_rows() -> list[dict[str, JsonValue]]:
    """Returns every kind as a row of a table, sizes in metres."""
    return [
        {
            "kind": each.kind,
            "width": size_text(each.width_m),
            "depth": size_text(each.depth_m),
            "height": size_text(each.height_m),
            "free floor": f"{each.clear_m:g}",
            "rooms": ", ".join((*each.essential, *each.likely)) or "only with others of its group, or where listed",
        }
        for each in furniture_kinds()
    ]


def furniture_picture(kind: str) -> str:
    """Returns the picture of a kind of furniture in a usual size (SVG), with the floor that is kept free before it."""
    model = CATALOGUE[kind]
    size = _usual_size(model)
    half = max(size[0], model.use_width_m) / 2
    front = size[1] / 2
    clear = Rectangle(x_min_m=-half, x_max_m=half, y_min_m=front, y_max_m=front + model.front_m)
    return solid_view_svg(kind, _solids(kind, size), clear)


def write_furniture_pictures(folder: Path) -> list[Path]:
    """Writes a picture of each kind into a folder, and returns their files.

    Raises:
        DocumentError: The folder cannot be written.
    """
    files = [folder / f"{kind}.svg" for kind in KINDS]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file, kind in zip(files, KINDS, strict=True):
            file.write_text(furniture_picture(kind), encoding="utf-8")
    except OSError as exc:
        fault = Fault(path="--pictures", value=f"{folder} ({exc.strerror})", allowed="a folder that can be written")
        raise DocumentError([fault], "simyard world furniture") from exc
    return files


def size_text(span: Range) -> str:
    """Returns from where to where something reaches, as one figure where both are the same."""
    low, high = span
    return f"{low:g}" if low == high else f"{low:g}-{high:g}"


def _kind(model: FurnitureType) -> FurnitureKind:
    # A depth of 0 stands for as deep as wide.
    depths = [variant.depth_m if variant.depth_m[1] else variant.width_m for variant in model.variants]
    rooms: dict[Tier, list[RoomType]] = {tier: [use.room for use in model.rooms if use.tier == tier] for tier in _TIERS}
    likely: list[RoomType] = [room for room in rooms["likely"] if room not in rooms["essential"]]
    known = {*rooms["essential"], *likely}
    rarely: list[RoomType] = [room for room in rooms["occasional"] if room not in known]
    return FurnitureKind(
        kind=model.name,
        width_m=_span([variant.width_m for variant in model.variants]),
        depth_m=_span(depths),
        height_m=_span([variant.height_m for variant in model.variants]),
        clear_m=model.front_m,
        stands=_stands(model),
        essential=tuple(rooms["essential"]),
        likely=tuple(likely),
        occasional=tuple(rarely),
    )


def _span(spans: Sequence[Range]) -> Range:
    return min(low for low, _ in spans), max(high for _, high in spans)


def _stands(model: FurnitureType) -> str:
    """Returns where a kind stands, and by what it likes to stand."""
    place = _STANDS[model.anchor] + (", flush beside others" if model.row else "")
    window = ", also below a window" if model.under_window else ""
    near = f", near {' or '.join(model.taste.near)}" if model.taste.near else ""
    return f"{place}{window}{near}"


def _usual_size(model: FurnitureType) -> Size:
    """Returns a size from the middle of what is usual in a room of 20 m2."""
    widths, depths, heights = model.usual(_USUAL_ROOM_M2)[-1].sizes
    width, depth, height = (each[len(each) // 2] for each in (widths, depths, heights))
    return width, depth or width, height


def _solids(kind: str, size: Size) -> tuple[Solid, ...]:
    body = Box(-size[0] / 2, -size[1] / 2, size[0] / 2, size[1] / 2)
    look = draw_look(np.random.default_rng(_LOOK_SEED))
    return assemble(Piece(kind, size, (0.0, 0.0), 0, 0.0, body), kind, "", look).solids
