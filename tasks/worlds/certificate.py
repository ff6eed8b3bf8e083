"""What a world guarantees, measured on its finished geometry."""

from collections.abc import Iterator, Sequence

import numpy as np

from specs.world import Certificate, Furniture, Passage, Room, Solid
from tasks.worlds.brief import Brief
from tasks.worlds.clearance import HEADROOM_M, Clearance, measure_clearance, reaches_room
from tasks.worlds.geometry import Box, rounded
from tasks.worlds.overlaps import count_overlaps
from tasks.worlds.scoring import WALL_M

ROBOT_RADIUS_M = 0.25
START_RADIUS_M = 1.0
_RADIUS_STEP_M = 0.01
_RADIUS_MAX_M = 1.0
_AREA_TOLERANCE = 0.03
_ASPECT_TOLERANCE = 0.25


def certify(
    brief: Brief,
    rooms: Sequence[Room],
    passages: Sequence[Passage],
    walls: Sequence[Solid],
    furniture: Sequence[Furniture],
    *,
    unmet: Sequence[str] = (),
) -> Certificate:
    """Returns a world's certificate.

    Args:
        brief: What the template asks for.
        rooms: The rooms, in the brief's order.
        passages: The ways between them.
        walls: All walls.
        furniture: All furniture.
        unmet: Wishes that are known to be unmet; those that can be measured are added.
    """
    solids = [*walls, *(solid for piece in furniture for solid in piece.solids)]
    floors = [_box(room) for room in rooms]
    clearance = measure_clearance(_around(floors).grown(WALL_M), solids)
    areas = [abs(floor.area - wish.area_m2) / wish.area_m2 for floor, wish in zip(floors, brief.rooms, strict=True)]
    return Certificate(
        origin_clear_radius_m=rounded(distance_to_origin(solids)),
        reachable_robot_radius_m=rounded(reachable_radius(clearance, floors)),
        narrowest_passage_m=rounded(min((passage.width_m for passage in passages), default=0.0)),
        free_floor_share=rounded(_free_share(clearance, floors)),
        area_error_mean=rounded(float(np.mean(areas))),
        overlaps=count_overlaps(furniture, walls),
        unmet=(*unmet, *brief.unsupported, *_unmet_shapes(brief, floors)),
    )


def distance_to_origin(solids: Sequence[Solid]) -> float:
    """Returns the distance on the floor from (0, 0) to the nearest solid that is not above head height (metres)."""
    low = [solid for solid in solids if solid.center_m[2] - solid.half_extents_m[2] < HEADROOM_M]
    x, y = np.array([solid.center_m[:2] for solid in low]).T
    half_x, half_y = np.array([solid.half_extents_m[:2] for solid in low]).T
    yaw = np.array([solid.yaw_rad for solid in low])
    ahead = np.maximum(np.abs(np.cos(yaw) * x + np.sin(yaw) * y) - half_x, 0.0)
    aside = np.maximum(np.abs(np.cos(yaw) * y - np.sin(yaw) * x) - half_y, 0.0)
    round_ones = np.array([solid.shape == "cylinder" for solid in low])
    distances = np.where(round_ones, np.sqrt(x * x + y * y) - half_x, np.sqrt(ahead * ahead + aside * aside))
    return max(float(distances.min()), 0.0)


def reachable_radius(clearance: Clearance, floors: Sequence[Box]) -> float:
    """Returns the largest radius (whole centimetres) with which every room is reached, by bisection; 0 for none."""
    low, high = 0, round(_RADIUS_MAX_M / _RADIUS_STEP_M) + 1
    while high - low > 1:
        middle = (low + high) // 2
        radius = middle * _RADIUS_STEP_M
        reached = clearance.reached(radius)
        holds = all(reaches_room(reached, clearance, floor, radius) for floor in floors)
        low, high = (middle, high) if holds else (low, middle)
    return low * _RADIUS_STEP_M


def broken_guarantees(certificate: Certificate) -> tuple[str, ...]:
    """Returns what a world promises and does not keep, one sentence each; none for a good world."""
    found: list[str] = []
    if certificate.origin_clear_radius_m < START_RADIUS_M:
        found.append(f"only {certificate.origin_clear_radius_m} m around the start are clear, not {START_RADIUS_M}")
    if certificate.reachable_robot_radius_m < ROBOT_RADIUS_M:
        radius = certificate.reachable_robot_radius_m
        found.append(f"a robot of {ROBOT_RADIUS_M} m radius does not reach every room, only one of {radius} m")
    if certificate.overlaps:
        found.append(f"{certificate.overlaps} pairs of things overlap")
    return tuple(found)


def _free_share(clearance: Clearance, floors: Sequence[Box]) -> float:
    covered = [clearance.covered[clearance.cells(floor)] for floor in floors]
    return 1.0 - sum(int(cells.sum()) for cells in covered) / sum(cells.size for cells in covered)


def _unmet_shapes(brief: Brief, floors: Sequence[Box]) -> Iterator[str]:
    for wish, floor in zip(brief.rooms, floors, strict=True):
        if abs(floor.area - wish.area_m2) > _AREA_TOLERANCE * wish.area_m2:
            yield f"{wish.name}: {floor.area:.1f} m2, wished {wish.area_m2:g} m2"
        if _misses(floor.width / floor.height, wish.aspect):
            yield f"{wish.name}: {floor.width:.2f} x {floor.height:.2f} m, wished {_proportions(wish.aspect)}"
    outline = _around(floors).grown(WALL_M)
    if _misses(outline.width / outline.height, brief.footprint_aspect):
        wished = _proportions(brief.footprint_aspect)
        yield f"footprint: {outline.width:.2f} x {outline.height:.2f} m, wished {wished}"


def _misses(found: float, wished: float) -> bool:
    return max(found / wished, wished / found) > 1 + _ASPECT_TOLERANCE


def _proportions(aspect: float) -> str:
    return f"{aspect:.3g}:1" if aspect >= 1 else f"1:{1 / aspect:.3g}"


def _box(room: Room) -> Box:
    floor = room.floor
    return Box(floor.x_min_m, floor.y_min_m, floor.x_max_m, floor.y_max_m)


def _around(boxes: Sequence[Box]) -> Box:
    low_x, low_y, high_x, high_y = zip(*boxes, strict=True)
    return Box(min(low_x), min(low_y), max(high_x), max(high_y))
