"""Homes of one room that is furnished and one that is empty, drawn by hand, for the tests of interiors."""

from dataclasses import replace

import numpy as np

from specs.data.world import Furniture, RoomType, Solid
from specs.template.interior import Density
from tasks.worlds.floorplan.floorplan import Cut, FloorPlan, Pane, build_walls
from tasks.worlds.floorplan.passages import Gap
from tasks.worlds.floorplan.scoring import WALL_M
from tasks.worlds.furnishing.assembly import Look, Palette, assemble
from tasks.worlds.furnishing.scene import Piece, RoomScene, open_scene
from tasks.worlds.furniture.furniture_type import Size, Style
from tasks.worlds.geometry import Box
from tasks.worlds.resolved_template import ResolvedTemplate, resolve_template
from tests.worlds.templates import furniture, room, template

ROBOT_M = 0.25
GREY = (0.5, 0.5, 0.5)
LOOK = Look(Style(raised=True, round=False), Palette(*[(0.1 * n, 0.1 * n, 0.1 * n) for n in range(1, 6)]))
NOWHERE = Box(0.0, 0.0, 0.0, 0.0)
_HALL_M = 2.4


def home(
    kind: RoomType,
    area_m2: float,
    density: Density,
    listed: list[str] | None = None,
    *,
    aspect: float = 1.2,
    radius_m: float = ROBOT_M,
    start_inside: bool = False,
    window: bool = False,
) -> tuple[ResolvedTemplate, FloorPlan]:
    """Returns a room of that kind north of an empty hall, a doorway between them, the start in one of the two.

    Args:
        kind: The room's type.
        area_m2: Its floor.
        density: How full it shall be.
        listed: The types that it may hold; None for any.
        aspect: Extent along x over extent along y.
        radius_m: Radius of the robot.
        start_inside: Whether the start is in the room's middle, or in the hall.
        window: Whether it has a window in its north wall.
    """
    width, depth = round((area_m2 * aspect) ** 0.5, 2), round((area_m2 / aspect) ** 0.5, 2)
    start_x, start_y = round(width / 2, 2), round(depth / 2 if start_inside else -_HALL_M / 2, 2)
    cells = (Box(0.0, 0.0, width + WALL_M, depth + WALL_M), Box(0.0, -_HALL_M - WALL_M, width + WALL_M, 0.0))
    door_m = max(0.9, 2 * radius_m + 0.25)
    gap = Gap((0, 1), "Doorway", (round(WALL_M + 0.1 + door_m / 2, 2), 0.0), door_m, "x", desired=True)
    pane = Pane(0, (round(width / 2, 2), round(depth + WALL_M, 2)), min(1.4, width - 0.5), "x", 0.9, 2.1)
    plan = FloorPlan(
        cells=tuple(Box(*(round(side, 2) for side in cell.shifted(-start_x, -start_y))) for cell in cells),
        gaps=(gap.shifted(-start_x, -start_y),),
        windows=(pane.shifted(-start_x, -start_y),) if window else (),
        cuts=(Cut("x", -start_y, -start_x, round(width + WALL_M - start_x, 2)),),
    )
    body = template(
        room("Room", kind, max(area_m2, 10.0)),
        room("Hall", "Hallway", 10.0),
        arrangements=(
            furniture({"RoomNames": ["Room"]}, listed, density),
            furniture({"RoomNames": ["Hall"]}, [], "Sparse"),
        ),
    )
    return replace(resolve_template(body), robot_radius_m=radius_m), plan


def walls_of(plan: FloorPlan) -> tuple[Solid, ...]:
    """Returns the walls of a home."""
    return build_walls(plan, 3.0, [GREY] * len(plan.cells))


def empty_scene(width_m: float = 5.0, depth_m: float = 4.0, *keep_clear: Box) -> RoomScene:
    """Returns an empty room far from (0, 0), so that the disc around the start is not in the way."""
    return open_scene(Box(10.0, 10.0, 10.0 + width_m, 10.0 + depth_m), keep_clear, ROBOT_M)


def standing(kind: str, size: Size, quarter: int = 0, askew_rad: float = 0.0, look: Look = LOOK) -> Furniture:
    """Returns a piece that stands in the middle of nowhere."""
    return assemble(Piece(kind, size, (5.0, 3.0), quarter, askew_rad, NOWHERE), f"{kind}_1", "Room", look)


def seen_at(piece: Furniture, height_m: float, rays: int = 200) -> list[bool]:
    """Returns which of many level rays from its front, side by side, meet a piece that stands as it was made."""
    cut = [solid for solid in piece.solids if abs(solid.center_m[2] - height_m) <= solid.half_extents_m[2]]
    low = min(solid.center_m[0] - solid.half_extents_m[0] for solid in piece.solids)
    high = max(solid.center_m[0] + solid.half_extents_m[0] for solid in piece.solids)
    return [
        any(abs(x - solid.center_m[0]) <= solid.half_extents_m[0] for solid in cut)
        for x in np.linspace(low + 1e-3, high - 1e-3, rays).tolist()
    ]
