"""The building on a floor plan: floors in their patterns, walls cut one metre above, doors, windows, names of rooms."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from specs.base import digest
from specs.data.world import Door, Finish, FloorZone, Pattern, Rectangle, Room, Solid, World, start_pose
from tasks.export.drawing.furniture_symbols import piece_box
from tasks.export.drawing.plan_page import (
    Attributes,
    PageBox,
    PageScale,
    bottom_m,
    css_color,
    draw_solid,
    element,
    fit_text,
    rectangle,
    text_width,
    top_m,
)

_FLOOR_TOWARDS_WHITE, _JOINT_TOWARDS_WHITE = 0.42, 0.25
_ZONE = "#5f6870"
_FEWEST_UNITS = 3.0  # lines closer than this on the page would be a grey, not a pattern


def draw_patterns(definitions: ET.Element, world: World, sheet: PageScale) -> None:
    """Adds a pattern of lines for each flooring of the world that is divided."""
    seen: set[str] = set()
    for room in world.rooms:
        key = pattern_key(room.flooring, sheet)
        if key and key not in seen:
            seen.add(key)
            along, across = (extent_m * sheet.units_per_m for extent_m in room.flooring.repeat_m)
            width, height, path = _PATHS[room.flooring.pattern](along, across)
            pattern = element(definitions, "pattern", id=key, width=width, height=height, patternUnits="userSpaceOnUse")
            element(
                pattern, "path", d=path, class_="joint", stroke=css_color(room.flooring.accent, _JOINT_TOWARDS_WHITE)
            )


def draw_floors(parent: ET.Element, world: World, sheet: PageScale) -> None:
    """Adds the footprint and every room's floor."""
    rectangle(parent, sheet.box(world.footprint), class_="threshold")
    for room in world.rooms:
        group = element(parent, "g", class_="room")
        floor = room.floor
        size = f"{floor.x_max_m - floor.x_min_m:.2f} by {floor.y_max_m - floor.y_min_m:.2f} m"
        materials = f"floor {room.flooring.material}, walls {room.walls.material}"
        element(group, "title", f"{room.name}: {room.type}, {area_m2(floor):.1f} m², {size}, {materials}")
        box = sheet.box(room.floor)
        rectangle(group, box, fill=floor_color(room.flooring))
        if key := pattern_key(room.flooring, sheet):
            rectangle(group, box, fill=f"url(#{key})")


def draw_zones(parent: ET.Element, world: World, sheet: PageScale) -> None:
    """Adds the outline and the name of every zone of an imported world."""
    for zone in world.zones or ():
        group = element(parent, "g", class_="zone")
        element(group, "title", f"{zone.name}: {zone.area_m2:.1f} m²")
        draw_zone_outline(group, zone, sheet, dashes="6 4")
        label = place_label(zone.name, [f"{zone.area_m2:.1f} m²"], sheet.box(zone.floor), [])
        _room_label(group, label, zone)


def draw_zone_outline(parent: ET.Element, zone: FloorZone, sheet: PageScale, dashes: str) -> None:
    """Adds the outline of a zone, dashed as SVG's ``stroke-dasharray`` says."""
    points = " ".join(f"{sheet.x(x):.2f},{sheet.y(y):.2f}" for x, y in zone.outline_m)
    element(parent, "polygon", points=points, fill="none", stroke=_ZONE, stroke_dasharray=dashes)


def floor_color(finish: Finish) -> str:
    """Returns the paper's colour of a flooring: pale, so that furniture and text stand out."""
    return css_color(finish.color, _FLOOR_TOWARDS_WHITE)


def pattern_key(finish: Finish, sheet: PageScale) -> str:
    """Returns the id of the pattern that a flooring is drawn with; empty for none."""
    if finish.pattern not in _PATHS or min(finish.repeat_m) * sheet.units_per_m < _FEWEST_UNITS:
        return ""
    return f"floor-{digest(finish)[:8]}"


def floor_m2(world: World) -> float:
    """Returns the floor of all rooms; of a world without rooms, what its map has free."""
    if world.rooms:
        return sum(area_m2(room.floor) for room in world.rooms)
    return sum(world.map.runs[::2]) * world.map.resolution_m**2


def area_m2(area: Rectangle) -> float:
    """Returns the area of a rectangle on the floor."""
    return (area.x_max_m - area.x_min_m) * (area.y_max_m - area.y_min_m)


def _planks(along: float, across: float) -> tuple[float, float, str]:
    rows = [
        f"M0 {row * across:.2f}H{along:.2f}M{row * 3 % 4 * along / 4:.2f} {row * across:.2f}v{across:.2f}"
        for row in range(4)
    ]
    return along, 4 * across, "".join(rows)


def _herringbone(along: float, across: float) -> tuple[float, float, str]:
    """Returns staves along x and y by turns; the pattern's side is two staves' length."""
    ratio = max(1, round(along / across))
    cells, cell = 2 * ratio, along / ratio
    lines: list[str] = []
    for number in range(cells):
        start = number * cell
        # A stave along x begins where row and column are equal, one along y a row below; both may wrap around.
        for wrapped in (start, start - cells * cell):
            lines.append(f"M{wrapped:.2f} {start:.2f}h{along:.2f}v{cell:.2f}h{-along:.2f}z")
            lines.append(f"M{start:.2f} {wrapped + cell:.2f}h{cell:.2f}v{along:.2f}h{-cell:.2f}z")
    return cells * cell, cells * cell, "".join(lines)


def _tiles(along: float, across: float) -> tuple[float, float, str]:
    return along, across, f"M0 0V{across:.2f}M0 0H{along:.2f}"


def _bricks(along: float, across: float) -> tuple[float, float, str]:
    return (
        along,
        2 * across,
        (f"M0 0H{along:.2f}M0 {across:.2f}H{along:.2f}M0 0V{across:.2f}M{along / 2:.2f} {across:.2f}v{across:.2f}"),
    )


def _boards(along: float, across: float) -> tuple[float, float, str]:
    return along, across, f"M0 0V{across:.2f}"


_PATHS: Mapping[Pattern, Callable[[float, float], tuple[float, float, str]]] = {
    "planks": _planks,
    "parquet": _herringbone,
    "tiles": _tiles,
    "bricks": _bricks,
    "stones": _bricks,
    "panels": _boards,
    "stripes": _boards,
}


def draw_passages(parent: ET.Element, world: World, sheet: PageScale) -> None:
    """Adds every doorway and opening as a gap, with its width as tooltip."""
    for passage in world.passages:
        group = element(parent, "g", class_=passage.kind.lower())
        wish = "" if passage.desired else ", added so that every room can be reached"
        first, second = passage.rooms
        element(group, "title", f"{passage.kind}, {passage.width_m:.2f} m: {first} to {second}{wish}")
        rectangle(
            group,
            sheet.box(_span(passage.center_m, passage.width_m, passage.along, world.wall_thickness_m)),
            class_="gap",
        )


def draw_doors(parent: ET.Element, world: World, sheet: PageScale) -> None:
    """Adds every hinged door as it stands, and the arc that its tip describes between shut and fully open."""
    for door in world.doors:
        group = element(parent, "g", class_="door")
        element(group, "title", f"{door.name}: {door.open_percent:g} % open, swings into {door.opens_into}")
        radius = _length_m(door) * sheet.units_per_m
        (from_x, from_y), (to_x, to_y) = (
            _tip(door, yaw_rad, sheet) for yaw_rad in (door.closed_yaw_rad, door.open_yaw_rad)
        )
        # Counter-clockwise with y up; SVG's sweep flag 1 is clockwise on the page.
        sweep = 0 if math.remainder(door.open_yaw_rad - door.closed_yaw_rad, 2 * math.pi) > 0 else 1
        x, y = sheet.x(door.hinge_m[0]), sheet.y(door.hinge_m[1])
        arc = f"M{from_x:.2f} {from_y:.2f}A{radius:.2f} {radius:.2f} 0 0 {sweep} {to_x:.2f} {to_y:.2f}L{x:.2f} {y:.2f}"
        element(group, "path", d=arc, class_="swing")
        draw_solid(group, door.leaf, sheet, {"class_": "leaf"})


def draw_windows(parent: ET.Element, world: World, sheet: PageScale) -> None:
    """Adds every window: the wall's faces and, between them, the glass."""
    for window in world.windows:
        group = element(parent, "g", class_="window")
        height = f"{window.bottom_m:.2f} to {window.top_m:.2f} m"
        element(group, "title", f"Window, {window.width_m:.2f} m, {height}: {window.room}")
        box = sheet.box(_span(window.center_m, window.width_m, window.along, world.wall_thickness_m))
        rectangle(group, box, class_="pane")
        x, y = box.center
        middle = (
            f"M{box.left:.2f} {y:.2f}H{box.right:.2f}"
            if window.along == "x"
            else f"M{x:.2f} {box.top:.2f}V{box.bottom:.2f}"
        )
        element(group, "path", d=middle, class_="glass")


def swing_box(door: Door, sheet: PageScale) -> PageBox:
    """Returns the page box that a door sweeps."""
    x, y = sheet.x(door.hinge_m[0]), sheet.y(door.hinge_m[1])
    tips = [_tip(door, yaw_rad, sheet) for yaw_rad in (door.closed_yaw_rad, door.open_yaw_rad)]
    xs, ys = [x, *(tip[0] for tip in tips)], [y, *(tip[1] for tip in tips)]
    return PageBox(min(xs), min(ys), max(xs), max(ys))


def _tip(door: Door, yaw_rad: float, sheet: PageScale) -> tuple[float, float]:
    length_m = _length_m(door)
    x_m, y_m = door.hinge_m
    return sheet.x(x_m + length_m * math.cos(yaw_rad)), sheet.y(y_m + length_m * math.sin(yaw_rad))


def _length_m(door: Door) -> float:
    return 2 * max(door.leaf.half_extents_m[:2])


def _span(center_m: tuple[float, float], width_m: float, along: str, thickness_m: float) -> Rectangle:
    half_m = width_m / 2, thickness_m / 2
    half_x_m, half_y_m = half_m if along == "x" else half_m[::-1]
    x_m, y_m = center_m
    return Rectangle(x_min_m=x_m - half_x_m, x_max_m=x_m + half_x_m, y_min_m=y_m - half_y_m, y_max_m=y_m + half_y_m)


NAME_SIZE = 18.0
DETAIL_SIZE = 12.5
_MIN_NAME_SIZE, _MIN_DETAIL_SIZE = 10.0, 8.0
_LINE = 1.25
_BOLD = 1.1  # of names, against text_width's upright face
_MARGIN = 6.0
_STEPS = 12
_SOFT_WEIGHT = 0.25


@dataclass(frozen=True)
class Label:
    """A name with a second line below it.

    Attributes:
        x: Page x of the middle.
        y: Page y of the middle.
        size: Type size of the name, page units.
        name: The name as it is printed, cut where nothing else helps.
        detail: The second line; empty where there is no room for one.
        detail_size: Its type size.
        upright: Whether the text runs upwards.
    """

    x: float
    y: float
    size: float
    name: str
    detail: str
    detail_size: float
    upright: bool

    @property
    def box(self) -> PageBox:
        """Returns the page box of the text."""
        along, across = _extent(self)
        half_x, half_y = (across / 2, along / 2) if self.upright else (along / 2, across / 2)
        return PageBox(self.x - half_x, self.y - half_y, self.x + half_x, self.y + half_y)


def place_label(
    name: str, details: Sequence[str], room: PageBox, obstacles: Sequence[PageBox], soft: Sequence[PageBox] = ()
) -> Label:
    """Returns the label of a room where it covers least of the obstacles, and of those places nearest the middle.

    Args:
        name: The room's name, any text.
        details: A second line in words, and shorter ones for rooms where it does not fit.
        room: The room's floor on the page.
        obstacles: Furniture and marks on the page.
        soft: What is better not covered, but rather than furniture.
    """
    inner = room.grown(-_MARGIN)
    upright = inner.height > inner.width and text_width(name, _BOLD * NAME_SIZE) > inner.width
    length, depth = (inner.height, inner.width) if upright else (inner.width, inner.height)
    size = _size(text_width(name, _BOLD * NAME_SIZE), length, NAME_SIZE, _MIN_NAME_SIZE)
    detail = next((text for text in details if text_width(text, DETAIL_SIZE) <= length), details[-1])
    detail_size = _size(text_width(detail, DETAIL_SIZE), length, DETAIL_SIZE, _MIN_DETAIL_SIZE)
    if text_width(detail, detail_size) > length or _LINE * (size + detail_size) > depth:
        detail = ""
    label = Label(0.0, 0.0, size, fit_text(name, _BOLD * size, length), detail, detail_size, upright)
    weights = [*((box, 1.0) for box in obstacles), *((box, _SOFT_WEIGHT) for box in soft)]
    x, y = _freest(inner, label.box, weights)
    return Label(x, y, size, label.name, detail, detail_size, upright)


def _extent(label: Label) -> tuple[float, float]:
    """Returns how long and how high a label is, before it is turned."""
    along = max(text_width(label.name, _BOLD * label.size), text_width(label.detail, label.detail_size))
    return along, _LINE * (label.size + (label.detail_size if label.detail else 0.0))


def _size(wanted: float, length: float, size: float, smallest: float) -> float:
    return size if wanted <= length else max(smallest, size * length / wanted)


def _freest(inner: PageBox, label: PageBox, obstacles: Sequence[tuple[PageBox, float]]) -> tuple[float, float]:
    """Returns the middle of the place, of a grid over the room, that covers least."""
    middle_x, middle_y = inner.center
    steps = range(-_STEPS, _STEPS + 1)
    x = [middle_x + max(0.0, inner.width - label.width) / 2 * step / _STEPS for step in steps]
    y = [middle_y + max(0.0, inner.height - label.height) / 2 * step / _STEPS for step in steps]
    covered = [[0.0] * len(steps) for _ in steps]
    for box, weight in obstacles:
        beside = [max(0.0, min(at + label.width / 2, box.right) - max(at - label.width / 2, box.left)) for at in x]
        above = [max(0.0, min(at + label.height / 2, box.bottom) - max(at - label.height / 2, box.top)) for at in y]
        for row, high in enumerate(above):
            if high:
                shares = zip(covered[row], beside, strict=True)
                covered[row] = [before + weight * high * wide for before, wide in shares]
    # Rounded, so that the last bit of a sum decides nothing; then the nearest, then the first.
    _, _, row, column = min(
        (round(1000 * covered[row][column]), abs(down) + abs(right), row, column)
        for row, down in enumerate(steps)
        for column, right in enumerate(steps)
    )
    return x[column], y[row]


START_RADIUS_M = 1.0  # docs/reference/robomaker.md, section 5: the cylinder around the origin that is always free
_CUT_M = 1.0  # an architect's plan looks down from about here
_MARK, _MARK_SIZE = "start", 11.5


def draw_walls(parent: ET.Element, walls: Sequence[Solid], sheet: PageScale) -> None:
    """Adds the walls: black where the cut goes through them, pale below it, dashed above it (lintels)."""
    for wall in sorted(walls, key=top_m):
        draw_solid(parent, wall, sheet, {"class_": _wall_class(wall)})


def draw_start(parent: ET.Element, world: World, sheet: PageScale) -> PageBox:
    """Adds the start, the circle that is free and the axes (x red, y green); returns the box of its text."""
    group = element(parent, "g", class_="start")
    start, free_m = start_pose(world), free_at_start_m(world)
    place = "the origin (0, 0)" if world.start is None else f"({start.x_m:g}, {start.y_m:g})"
    element(group, "title", f"Start of the robot: {place}; {free_m:g} m around it is free")
    x, y, unit = sheet.x(start.x_m), sheet.y(start.y_m), sheet.units_per_m
    element(group, "circle", cx=x, cy=y, r=free_m * unit, class_="clear")
    arm = 0.35 * unit
    element(group, "path", d=f"M{x:.2f} {y:.2f}h{arm:.2f}m-5 -4l5 4l-5 4", class_="axis-x")
    element(group, "path", d=f"M{x:.2f} {y:.2f}v{-arm:.2f}m-4 5l4 -5l4 5", class_="axis-y")
    element(group, "circle", cx=x, cy=y, r=3.5, class_="origin")
    element(group, "text", _MARK, x=x - 6, y=y + 15, class_="mark", font_size=_MARK_SIZE, text_anchor="end")
    return PageBox(x - 6 - text_width(_MARK, _MARK_SIZE), y + 4, x - 6, y + 18)


def free_at_start_m(world: World) -> float:
    """Returns the radius of the circle around the start that is drawn as free."""
    return START_RADIUS_M if world.start is None else min(START_RADIUS_M, world.certificate.origin_clear_radius_m)


def draw_room_labels(parent: ET.Element, world: World, sheet: PageScale) -> list[PageBox]:
    """Adds name, area and free share of every room, where they cover least; returns the boxes of the texts."""
    reach, begin = START_RADIUS_M * sheet.units_per_m, start_pose(world)
    x, y = sheet.x(begin.x_m), sheet.y(begin.y_m)
    axes = PageBox(x - 0.55 * reach, y - 0.45 * reach, x + 0.45 * reach, y + 0.3 * reach)
    obstacles = [piece_box(piece, sheet).grown(3.0) for piece in world.furniture]
    obstacles += [axes, *(swing_box(door, sheet) for door in world.doors)]
    start = PageBox(x - reach, y - reach, x + reach, y + reach)
    free = {figures.room: figures.free_floor_share for figures in world.certificate.rooms}
    labels: list[PageBox] = []
    for room in world.rooms:
        area = f"{area_m2(room.floor):.1f} m²"
        details = [f"{area} · {100 * free[room.name]:.0f} % free", area] if room.name in free else [area]
        label = place_label(room.name, details, sheet.box(room.floor), obstacles, [start])
        _room_label(parent, label, room)
        labels.append(label.box)
    return labels


def _room_label(parent: ET.Element, label: Label, room: Room | FloorZone) -> None:
    turn: Attributes = {"transform": f"rotate(-90 {label.x:.2f} {label.y:.2f})"} if label.upright else {}
    group = element(parent, "g", class_="label", **turn)
    if label.name != room.name:
        element(group, "title", room.name)
    baseline = label.y - 2 if label.detail else label.y + 0.36 * label.size
    element(group, "text", label.name, x=label.x, y=baseline, font_size=label.size, class_="name")
    if label.detail:
        y = label.y + label.detail_size
        element(group, "text", label.detail, x=label.x, y=y, font_size=label.detail_size)


def _wall_class(wall: Solid) -> str:
    if bottom_m(wall) >= _CUT_M:
        return "lintel"
    return "wall" if top_m(wall) > _CUT_M else "low-wall"
