"""What a world guarantees, measured on its finished geometry."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from specs.data.world import Certificate, Door, Furniture, Passage, Room, RoomFigures, Solid
from tasks.worlds.brief import Brief
from tasks.worlds.certificate.wishes import weigh_wishes
from tasks.worlds.floorplan.doors import LEAF_PLAY_M, LEAF_THICKNESS_M, open_leaves
from tasks.worlds.floorplan.scoring import WALL_M
from tasks.worlds.geometry.boxes import EPSILON_M, Box, bounding_box, rounded
from tasks.worlds.geometry.clearance import (
    CELL_M,
    HEADROOM_M,
    RADIUS_MAX_M,
    Clearance,
    connected_share,
    measure_clearance,
    reaches_room,
)
from tasks.worlds.geometry.overlaps import Rows, count_overlaps, solid_rows

START_RADIUS_M = 1.0
_RADIUS_STEP_M = 0.01


@dataclass(frozen=True)
class Survey:
    """Where a robot can drive.

    Attributes:
        opened: With all doors fully open.
        as_set: With the doors as they stand.
    """

    opened: Clearance
    as_set: Clearance


def survey(
    rooms: Sequence[Room],
    passages: Sequence[Passage],
    walls: Sequence[Solid],
    furniture: Sequence[Furniture],
    doors: Sequence[Door] = (),
) -> Survey:
    """Returns the clearances of a finished world.

    Args:
        rooms: All rooms.
        passages: The ways between them.
        walls: All walls.
        furniture: All furniture.
        doors: All doors, as they stand.
    """
    as_set = survey_as_set(rooms, walls, furniture, [door.leaf for door in doors])
    if all(door.open_percent == 100.0 for door in doors):
        return Survey(as_set, as_set)
    return Survey(survey_as_set(rooms, walls, furniture, open_leaves(doors, passages)), as_set)


def survey_as_set(
    rooms: Sequence[Room], walls: Sequence[Solid], furniture: Sequence[Furniture], leaves: Sequence[Solid]
) -> Clearance:
    """Returns the clearance of a finished world with its doors as their leaves stand.

    Args:
        rooms: All rooms.
        walls: All walls.
        furniture: All furniture.
        leaves: The leaves of all doors.
    """
    area = bounding_box([_box(room) for room in rooms]).grown(WALL_M)
    return measure_clearance(area, [*walls, *(solid for piece in furniture for solid in piece.solids), *leaves])


def certify(
    brief: Brief,
    rooms: Sequence[Room],
    passages: Sequence[Passage],
    *,
    walls: Sequence[Solid],
    furniture: Sequence[Furniture],
    doors: Sequence[Door] = (),
    surveyed: Survey | None = None,
) -> Certificate:
    """Returns a world's certificate.

    Args:
        brief: What the template asks for.
        rooms: The rooms, in the brief's order.
        passages: The ways between them.
        walls: All walls.
        furniture: All furniture.
        doors: All doors.
        surveyed: The clearances, where they are known already.
    """
    clear = surveyed or survey(rooms, passages, walls, furniture, doors)
    floors = [_box(room) for room in rooms]
    figures = tuple(_figures(brief, clear.opened, rooms))
    reachable, as_set = _reachable_radii(clear, rooms, passages)
    leaves = [door.leaf for door in doors]
    solids = [*[solid for piece in furniture for solid in piece.solids], *leaves, *walls]
    rows = solid_rows(solids)
    return Certificate(
        origin_clear_radius_m=rounded(distance_to_origin(solids, rows)),
        guaranteed_robot_radius_m=rounded(brief.robot_radius_m),
        reachable_robot_radius_m=rounded(reachable),
        doors_as_set_robot_radius_m=rounded(as_set),
        narrowest_passage_m=rounded(narrowest_passage(passages, doors)),
        free_floor_share=rounded(_free_share(clear.opened, floors)),
        area_error_mean=rounded(_area_error_mean(brief, floors)),
        overlaps=count_overlaps(furniture, walls, leaves, rows),
        rooms=figures,
        wishes=weigh_wishes(brief, rooms, passages, furniture, doors, figures=figures, outline_m=_outline(floors)),
    )


def _outline(floors: Sequence[Box]) -> tuple[float, float]:
    """Returns the extents of the footprint along x and y (metres)."""
    box = bounding_box(floors).grown(WALL_M)
    return box.width, box.height


def _area_error_mean(brief: Brief, floors: Sequence[Box]) -> float:
    """Returns by what share rooms miss their wished areas on average."""
    errors = [abs(floor.area - wish.area_m2) / wish.area_m2 for floor, wish in zip(floors, brief.rooms, strict=True)]
    return float(np.mean(errors))


def _reachable_radii(clear: Survey, rooms: Sequence[Room], passages: Sequence[Passage]) -> tuple[float, float]:
    """Returns the reachable radius with all doors fully open, and with the doors as they stand."""
    opened = _reachable_radius(clear.opened, rooms, passages)
    return opened, opened if clear.as_set is clear.opened else _reachable_radius(clear.as_set, rooms, passages)


def narrowest_passage(passages: Sequence[Passage], doors: Sequence[Door]) -> float:
    """Returns the clear width of the narrowest passage with all doors fully open (metres), 0 for no passage.

    An open leaf stands in its doorway's width with its thickness, a hinge's play away from the jamb.
    """
    hung = {door.passage for door in doors}
    leaf = LEAF_THICKNESS_M + LEAF_PLAY_M
    widths = (passage.width_m - (leaf if number in hung else 0.0) for number, passage in enumerate(passages))
    return min(widths, default=0.0)


def _figures(brief: Brief, clear: Clearance, rooms: Sequence[Room]) -> Iterator[RoomFigures]:
    reached = clear.reached(brief.robot_radius_m)
    for room in rooms:
        floor = _box(room)
        yield RoomFigures(
            room=room.name,
            area_m2=rounded(floor.area),
            free_floor_share=rounded(_free_share(clear, [floor])),
            reached_share=rounded(connected_share(reached, clear, floor, brief.robot_radius_m)),
        )


def distance_to_origin(solids: Sequence[Solid], rows: Rows) -> float:
    """Returns the distance on the floor from (0, 0) to the nearest solid that is not above head height (metres)."""
    low = rows[:, 2] - rows[:, 5] < HEADROOM_M
    x, y, _, half_x, half_y, _, yaw = rows[low].T
    cos, sin = np.cos(yaw), np.sin(yaw)
    ahead = np.maximum(np.abs(cos * x + sin * y) - half_x, 0.0)
    aside = np.maximum(np.abs(cos * y - sin * x) - half_y, 0.0)
    round_ones = np.array([solid.shape == "cylinder" for solid in solids])[low]
    distances = np.where(round_ones, np.sqrt(x * x + y * y) - half_x, np.sqrt(ahead * ahead + aside * aside))
    return max(float(distances.min()), 0.0)


def _reachable_radius(clearance: Clearance, rooms: Sequence[Room], passages: Sequence[Passage]) -> float:
    """Returns the largest radius (whole centimetres) with which every room is reached; 0 for none.

    Most often the passages alone decide it, or something a little narrower does. So what they let through is tried
    first, then less and less, each step twice as long as the one before; what is left between two steps is halved.
    """
    floors = [_box(room) for room in rooms]
    middle = math.floor(_most_through(clearance, rooms, passages) / _RADIUS_STEP_M + EPSILON_M)
    low, high, down = 0, middle + 1, 1
    while high - low > 1:
        holds = _reaches_all(clearance, floors, middle * _RADIUS_STEP_M)
        low, high = (middle, high) if holds else (low, middle)
        middle = (low + high) // 2 if low else max(middle - down, 1)
        down *= 2
    return low * _RADIUS_STEP_M


def _most_through(clearance: Clearance, rooms: Sequence[Room], passages: Sequence[Passage]) -> float:
    """Returns a radius that no robot exceeds which gets into every room: each has to be entered by a passage of its."""
    through = [clearance.widest_radius(_threshold(passage)) for passage in passages]
    starts = [
        room.name
        for room in rooms
        if room.floor.x_min_m < 0 < room.floor.x_max_m and room.floor.y_min_m < 0 < room.floor.y_max_m
    ]
    widest = [
        max(
            (radius for radius, passage in zip(through, passages, strict=True) if room.name in passage.rooms),
            default=0.0,
        )
        for room in rooms
        if room.name not in starts
    ]
    return max(min([*widest, RADIUS_MAX_M]), 0.0)


def _reaches_all(clearance: Clearance, floors: Sequence[Box], radius_m: float) -> bool:
    reached = clearance.reached(radius_m)
    return all(reaches_room(reached, clearance, floor, radius_m) for floor in floors)


def _threshold(passage: Passage) -> Box:
    """Returns the strip of floor, in the middle of a passage's wall, that whoever takes it has to cross."""
    (x, y), half = passage.center_m, passage.width_m / 2 + CELL_M
    return (
        Box(x - half, y - CELL_M, x + half, y + CELL_M)
        if passage.along == "x"
        else Box(x - CELL_M, y - half, x + CELL_M, y + half)
    )


def broken_guarantees(certificate: Certificate) -> tuple[str, ...]:
    """Returns what a world promises and does not keep, one sentence each; none for a good world."""
    found: list[str] = []
    if certificate.origin_clear_radius_m < START_RADIUS_M:
        found.append(f"only {certificate.origin_clear_radius_m} m around the start are clear, not {START_RADIUS_M}")
    asked, radius = certificate.guaranteed_robot_radius_m, certificate.reachable_robot_radius_m
    if radius < asked:
        found.append(f"a robot of {asked} m radius does not reach every room, only one of {radius} m")
    if certificate.overlaps:
        found.append(f"{certificate.overlaps} pairs of things overlap")
    return tuple(found)


def _free_share(clearance: Clearance, floors: Sequence[Box]) -> float:
    covered = [clearance.covered[clearance.cells(floor)] for floor in floors]
    return 1.0 - sum(int(cells.sum()) for cells in covered) / sum(cells.size for cells in covered)


def _box(room: Room) -> Box:
    floor = room.floor
    return Box(floor.x_min_m, floor.y_min_m, floor.x_max_m, floor.y_max_m)
