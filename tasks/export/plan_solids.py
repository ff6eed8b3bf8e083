"""Solids seen from above."""

import math
from collections.abc import Iterable
from xml.etree import ElementTree as ET

from specs.world import Solid
from tasks.export.plan_page import Attributes, Box, Sheet, element, rectangle


def draw_solid(parent: ET.Element, solid: Solid, sheet: Sheet, attributes: Attributes) -> None:
    """Adds the outline of a solid."""
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


def page_box(solids: Iterable[Solid], center_m: tuple[float, float], sheet: Sheet) -> Box:
    """Returns the page box around solids, or an empty one at ``center_m`` where there are none."""
    corners = [corner for solid in solids for corner in corners_m(solid)] or [center_m]
    xs, ys = [x for x, _ in corners], [y for _, y in corners]
    return Box(sheet.x(min(xs)), sheet.y(max(ys)), sheet.x(max(xs)), sheet.y(min(ys)))


def corners_m(solid: Solid) -> list[tuple[float, float]]:
    """Returns the corners of a solid's outline; of a cylinder, of the square around it."""
    x_m, y_m, _ = solid.center_m
    half_x_m, half_y_m, _ = solid.half_extents_m
    cos, sin = math.cos(solid.yaw_rad), math.sin(solid.yaw_rad)
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return [
        (x_m + sx * half_x_m * cos - sy * half_y_m * sin, y_m + sx * half_x_m * sin + sy * half_y_m * cos)
        for sx, sy in signs
    ]


def covers(solid: Solid, x_m: float, y_m: float) -> bool:
    """Returns whether a place on the floor is below a solid."""
    dx_m, dy_m = x_m - solid.center_m[0], y_m - solid.center_m[1]
    half_x_m, half_y_m, _ = solid.half_extents_m
    if solid.shape == "cylinder":
        return math.hypot(dx_m, dy_m) <= half_x_m
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
