"""The plan itself: floors, walls as cut one metre above them, ways through, furniture solid by solid, the start."""

import math
import re
from collections.abc import Sequence
from xml.etree import ElementTree as ET

from specs.world import Furniture, Passage, Rectangle, Room, Solid, World
from tasks.export.plan_labels import AREA_SIZE, Label, place_label
from tasks.export.plan_page import Attributes, Box, Sheet, css_color, element, rectangle, text_width

START_RADIUS_M = 1.0  # semantics 5: the cylinder around the origin that is always free
_CUT_M = 1.0  # an architect's plan looks down from about here
_PIECE_LABEL_SIZES = (11.0, 9.0)
_FLOOR_TOWARDS_WHITE = 0.30
# Line spacing of each material's pattern (x, y), metres; None draws no lines that way.
_PATTERNS: dict[str, tuple[float | None, float | None]] = {
    "floorboards": (None, 0.14),
    "parquetry": (0.30, 0.10),
    "tiles": (0.30, 0.30),
    "linoleum": (0.60, 0.60),
}


def draw_patterns(definitions: ET.Element, world: World, sheet: Sheet) -> None:
    """Adds a pattern of lines for each floor material of the world that has one."""
    for material in sorted({_pattern_key(room.flooring.material) for room in world.rooms} & _PATTERNS.keys()):
        x_m, y_m = _PATTERNS[material]
        width, height = (x_m or 1.0) * sheet.units_per_m, (y_m or 1.0) * sheet.units_per_m
        pattern = element(
            definitions,
            "pattern",
            id=f"floor-{material}",
            width=width,
            height=height,
            patternUnits="userSpaceOnUse",
        )
        path = (f"M0 0V{height:.2f}" if x_m else "") + (f"M0 0H{width:.2f}" if y_m else "")
        element(pattern, "path", d=path, class_="joint")


def draw_floors(parent: ET.Element, world: World, sheet: Sheet) -> None:
    """Adds the footprint and every room's floor in its colour."""
    rectangle(parent, sheet.box(world.footprint), class_="threshold")
    for room in world.rooms:
        group = element(parent, "g", class_="room")
        element(group, "title", _room_facts(room))
        box = sheet.box(room.floor)
        rectangle(group, box, fill=css_color(room.flooring.color, _FLOOR_TOWARDS_WHITE))
        if (key := _pattern_key(room.flooring.material)) in _PATTERNS:
            rectangle(group, box, fill=f"url(#floor-{key})")


def draw_walls(parent: ET.Element, walls: Sequence[Solid], sheet: Sheet) -> None:
    """Adds the walls: black where the cut goes through them, pale below it, dashed above it (lintels)."""
    for wall in sorted(walls, key=_top_m):
        _solid(parent, wall, sheet, {"class_": _wall_class(wall)})


def draw_passages(parent: ET.Element, world: World, sheet: Sheet) -> None:
    """Adds every doorway and opening as a gap with its reveal lines and its width as tooltip."""
    for passage in world.passages:
        group = element(parent, "g", class_=passage.kind.lower())
        wish = "" if passage.desired else ", added so that every room can be reached"
        first, second = passage.rooms
        element(group, "title", f"{passage.kind}, {passage.width_m:.2f} m: {first} to {second}{wish}")
        rectangle(group, sheet.box(_gap(passage, world.wall_thickness_m)), class_="gap")


def draw_furniture(parent: ET.Element, pieces: Sequence[Furniture], sheet: Sheet) -> None:
    """Adds every piece from its solids, lowest first, with its name as tooltip, and as text where it fits."""
    for piece in sorted(pieces, key=lambda piece: max(map(_top_m, piece.solids), default=0.0)):
        group = element(parent, "g", class_="furniture")
        box = piece_box(piece, sheet)
        element(group, "title", f"{piece.name}: {piece.model_type}, in {piece.room}")
        for solid in sorted(piece.solids, key=_top_m):
            _solid(group, solid, sheet, {"fill": css_color(solid.color, 0.12)})
        _piece_label(group, piece, box)


def draw_start(parent: ET.Element, sheet: Sheet) -> None:
    """Adds the origin: the circle of 1 m that is free, and the axes (x red, y green)."""
    group = element(parent, "g", class_="start")
    element(group, "title", "Start of the robot: the origin (0, 0); 1 m around it is free")
    x, y, unit = sheet.x(0.0), sheet.y(0.0), sheet.units_per_m
    element(group, "circle", cx=x, cy=y, r=START_RADIUS_M * unit, class_="clear")
    arm = 0.35 * unit
    element(group, "path", d=f"M{x:.2f} {y:.2f}h{arm:.2f}m-5 -4l5 4l-5 4", class_="axis-x")
    element(group, "path", d=f"M{x:.2f} {y:.2f}v{-arm:.2f}m-4 5l4 -5l4 5", class_="axis-y")
    element(group, "circle", cx=x, cy=y, r=3.5, class_="origin")
    element(group, "text", "start", x=x - 6, y=y + 15, class_="mark", text_anchor="end")


def draw_room_labels(parent: ET.Element, world: World, sheet: Sheet) -> None:
    """Adds name and area of every room, where they cover least."""
    obstacles = [piece_box(piece, sheet).grown(3.0) for piece in world.furniture]
    obstacles.append(sheet.box(Rectangle(x_min_m=-0.6, y_min_m=-0.3, x_max_m=0.5, y_max_m=0.5)))
    reach_m = START_RADIUS_M
    start = Rectangle(x_min_m=-reach_m, y_min_m=-reach_m, x_max_m=reach_m, y_max_m=reach_m)
    for room in world.rooms:
        detail = f"{_area_m2(room):.1f} m²"
        label = place_label(room.name, detail, sheet.box(room.floor), obstacles, [sheet.box(start)])
        _room_label(parent, label, room)


def piece_box(piece: Furniture, sheet: Sheet) -> Box:
    """Returns the page box around all solids of a piece, or an empty one at its centre."""
    corners = [corner for solid in piece.solids for corner in _corners_m(solid)] or [piece.center_m]
    xs, ys = [x for x, _ in corners], [y for _, y in corners]
    return Box(sheet.x(min(xs)), sheet.y(max(ys)), sheet.x(max(xs)), sheet.y(min(ys)))


def _room_label(parent: ET.Element, label: Label, room: Room) -> None:
    turn: Attributes = {"transform": f"rotate(-90 {label.x:.2f} {label.y:.2f})"} if label.upright else {}
    group = element(parent, "g", class_="label", **turn)
    if label.name != room.name:
        element(group, "title", room.name)
    element(group, "text", label.name, x=label.x, y=label.y - 2, font_size=label.size, class_="name")
    element(group, "text", label.detail, x=label.x, y=label.y + AREA_SIZE, font_size=AREA_SIZE)


def _piece_label(group: ET.Element, piece: Furniture, box: Box) -> None:
    upright = box.height > box.width
    length, across = (box.height, box.width) if upright else (box.width, box.height)
    text = _in_words(piece.name)
    size = next((size for size in _PIECE_LABEL_SIZES if text_width(text, size) <= length), 0.0)
    if not piece.solids or not size or across < size:
        return
    x, y = box.center
    turn: Attributes = {"transform": f"rotate(-90 {x:.2f} {y:.2f})"} if upright else {}
    ground = "dark" if _luma(_widest(piece)) < 0.5 else "light"
    element(group, "text", text, x=x, y=y + 0.36 * size, font_size=size, class_=f"piece on-{ground}", **turn)


def _in_words(name: str) -> str:
    """Returns ``Console tables 1`` for ``ConsoleTables_1``."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|[_\s]+", " ", name).split()
    return " ".join([*words[:1], *(word.lower() for word in words[1:])])


def _widest(piece: Furniture) -> Solid:
    return max(piece.solids, key=lambda solid: solid.half_extents_m[0] * solid.half_extents_m[1])


def _luma(solid: Solid) -> float:
    """Returns how bright a solid is, 0-1 (ITU-R BT.709)."""
    red, green, blue = solid.color
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def _solid(parent: ET.Element, solid: Solid, sheet: Sheet, attributes: Attributes) -> None:
    x, y = sheet.x(solid.center_m[0]), sheet.y(solid.center_m[1])
    half_x, half_y = (half * sheet.units_per_m for half in solid.half_extents_m[:2])
    if solid.shape == "cylinder":
        element(parent, "circle", cx=x, cy=y, r=half_x, **attributes)
        return
    # Counter-clockwise with y up is negative with y down.
    turn: Attributes = (
        {"transform": f"rotate({-math.degrees(solid.yaw_rad):.3f} {x:.2f} {y:.2f})"} if solid.yaw_rad else {}
    )
    rectangle(parent, Box(x - half_x, y - half_y, x + half_x, y + half_y), **{**attributes, **turn})


def _corners_m(solid: Solid) -> list[tuple[float, float]]:
    x_m, y_m, _ = solid.center_m
    half_x_m, half_y_m, _ = solid.half_extents_m
    cos, sin = math.cos(solid.yaw_rad), math.sin(solid.yaw_rad)
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return [
        (x_m + sx * half_x_m * cos - sy * half_y_m * sin, y_m + sx * half_x_m * sin + sy * half_y_m * cos)
        for sx, sy in signs
    ]


def _wall_class(wall: Solid) -> str:
    bottom_m = wall.center_m[2] - wall.half_extents_m[2]
    if bottom_m >= _CUT_M:
        return "lintel"
    return "wall" if _top_m(wall) > _CUT_M else "low-wall"


def _gap(passage: Passage, thickness_m: float) -> Rectangle:
    x_m, y_m = passage.center_m
    half_m = passage.width_m / 2, thickness_m / 2
    half_x_m, half_y_m = half_m if passage.along == "x" else half_m[::-1]
    return Rectangle(x_min_m=x_m - half_x_m, x_max_m=x_m + half_x_m, y_min_m=y_m - half_y_m, y_max_m=y_m + half_y_m)


def _top_m(solid: Solid) -> float:
    return solid.center_m[2] + solid.half_extents_m[2]


def _area_m2(room: Room) -> float:
    return (room.floor.x_max_m - room.floor.x_min_m) * (room.floor.y_max_m - room.floor.y_min_m)


def _size(area: Rectangle) -> str:
    return f"{area.x_max_m - area.x_min_m:.2f} by {area.y_max_m - area.y_min_m:.2f} m"


def _room_facts(room: Room) -> str:
    materials = f"floor {room.flooring.material}, walls {room.walls.material}"
    return f"{room.name}: {room.type}, {_area_m2(room):.1f} m², {_size(room.floor)}, {materials}"


def _pattern_key(material: str) -> str:
    return material.lower().replace(" ", "")
