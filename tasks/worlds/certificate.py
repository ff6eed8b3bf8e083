"""What a world guarantees, measured on its finished geometry, and what became of each wish of its template.

What a template has where its author said nothing is no wish: proportions of 1:1, a room that is 20 m2 and 1:1, and
moderate density beside a list of furniture. Whether these were written or filled in cannot be told: nobody can write a
room's area without its proportions, RoboMaker's samples write all of it, and writing it gives the same worlds.

A world with less furniture is measured anew: it is what is left of a world when a failure is narrowed down.
"""

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import chain

import numpy as np

from specs.data.world import Certificate, Door, Furniture, Passage, Room, RoomFigures, Solid, Wish, World
from specs.template.body import TemplateBody
from tasks.worlds.floorplan.doors import LEAF_PLAY_M, LEAF_THICKNESS_M
from tasks.worlds.floorplan.scoring import WALL_M
from tasks.worlds.geometry import (
    CELL_M,
    EPSILON_M,
    HEADROOM_M,
    Box,
    Rows,
    bounding_box,
    connected_share,
    count_overlaps,
    reaches_room,
    room_box,
    rounded,
    solid_rows,
)
from tasks.worlds.materials import FLOORINGS, WALLS, SurfaceMaterial, known_name
from tasks.worlds.resolved_template import (
    DEFAULT_AREA_M2,
    FREE_FLOOR,
    ConnectionWish,
    ResolvedTemplate,
    RoomWish,
    resolve_template,
)
from tasks.worlds.survey import ExactGrid, Survey, most_through, survey

AREA_TOLERANCE = 0.03
ASPECT_TOLERANCE = 0.25
_SQUARE = 1.0
START_RADIUS_M = 1.0
_RADIUS_STEP_M = 0.01
SHRUNK = "shrunk"
"""What the generator of such a world is called after the name of the one that made it."""
_ABOUT_FURNITURE = ("furniture", "density")


def weigh_wishes(
    resolved: ResolvedTemplate,
    rooms: Sequence[Room],
    passages: Sequence[Passage],
    furniture: Sequence[Furniture],
    doors: Sequence[Door],
    *,
    figures: Sequence[RoomFigures],
    outline_m: tuple[float, float],
) -> tuple[Wish, ...]:
    """Returns every measurable wish with what was found, in a fixed order: home, then rooms, then ways between them.

    Args:
        resolved: What the template asks for.
        rooms: The finished rooms, in the template's order.
        passages: The ways between them.
        furniture: All furniture.
        doors: All doors.
        figures: The certificate's figures, by room.
        outline_m: The footprint's extents along x and y.
    """
    by_room: list[Iterator[Wish]] = []
    for wish, room, figure in zip(resolved.rooms, rooms, figures, strict=True):
        pieces = [piece.model_type for piece in furniture if piece.room == wish.name]
        by_room += [_shape(wish, room), _surfaces(wish, room), _furnishing(wish, pieces, figure)]
    footprint = _aspect("footprint", "footprint", outline_m, resolved.footprint_aspect)
    return (*footprint, *chain(*by_room), *_connections(resolved, passages), *_doors(resolved, passages, doors))


def _shape(wish: RoomWish, room: Room) -> Iterator[Wish]:
    width, depth = room.floor.x_max_m - room.floor.x_min_m, room.floor.y_max_m - room.floor.y_min_m
    if (wish.area_m2, wish.aspect) == (DEFAULT_AREA_M2, _SQUARE):
        return
    area = width * depth
    error = abs(area - wish.area_m2) / wish.area_m2
    yield Wish(
        kind="area",
        subject=wish.name,
        wished=f"{wish.area_m2:g} m2",
        found=f"{area:.1f} m2",
        met=error <= AREA_TOLERANCE,
        error=rounded(error),
    )
    yield from _aspect("aspect", wish.name, (width, depth), wish.aspect)


def _aspect(kind: str, subject: str, extents: tuple[float, float], wished: float) -> Iterator[Wish]:
    if wished == _SQUARE:
        return
    found = extents[0] / extents[1]
    error = max(found / wished, wished / found) - 1.0
    yield Wish.model_validate(
        {
            "kind": kind,
            "subject": subject,
            "wished": _proportions(wished),
            "found": f"{extents[0]:.2f} x {extents[1]:.2f} m, {_proportions(found)}",
            "met": error <= ASPECT_TOLERANCE,
            "error": rounded(error),
        }
    )


def _proportions(aspect: float) -> str:
    return f"{aspect:.3g}:1" if aspect >= 1 else f"1:{1 / aspect:.3g}"


def _surfaces(wish: RoomWish, room: Room) -> Iterator[Wish]:
    yield from _material("flooring", wish.name, wish.floorings, room.flooring.material, FLOORINGS)
    yield from _material("walls", wish.name, wish.walls, room.walls.material, WALLS)


def _material(
    kind: str, subject: str, wished: tuple[str, ...], found: str, known: Mapping[str, SurfaceMaterial]
) -> Iterator[Wish]:
    if not wished:
        return
    names = {known_name(name, known) for name in wished}
    fields = {"kind": kind, "subject": subject}
    yield Wish.model_validate({**fields, "wished": " or ".join(wished), "found": found, "met": found in names})
    for unknown in (name for name in wished if known_name(name, known) is None):
        there_are = f"no such material; there are {', '.join(known)}"
        yield Wish.model_validate({**fields, "wished": unknown, "found": there_are, "met": False})


def _furnishing(wish: RoomWish, pieces: Sequence[str], figures: RoomFigures) -> Iterator[Wish]:
    if wish.furniture is not None:
        found = sorted(set(pieces))
        met = bool(found) == bool(wish.furniture) and set(found) <= set(wish.furniture)
        wished = " or ".join(wish.furniture) or "none"
        yield Wish(kind="furniture", subject=wish.name, wished=wished, found=", ".join(found) or "none", met=met)
    if wish.density_wished and wish.furniture != ():
        least, most = FREE_FLOOR[wish.density]
        share = round(figures.free_floor_share, 2)  # as it is told, so that 80 % is not above 80 %
        yield Wish(
            kind="density",
            subject=wish.name,
            wished=f"{wish.density} ({100 * least:.0f} to {100 * most:.0f} % of the floor free)",
            found=f"{100 * share:.0f} % free",
            met=least <= share <= most,
        )


def _connections(resolved: ResolvedTemplate, passages: Sequence[Passage]) -> Iterator[Wish]:
    built = Counter((frozenset(passage.rooms), passage.kind) for passage in passages if passage.desired)
    for wish, count in Counter(resolved.connections).items():
        pair = _names(resolved, wish)
        found = {kind: built[frozenset(pair), kind] for kind in ("Doorway", "Opening")}
        yield Wish(
            kind="connection",
            subject=" - ".join(pair),
            wished=_ways(wish.kind, count),
            found=" and ".join(_ways(kind, number) for kind, number in found.items() if number) or "none",
            met=found[wish.kind] >= count,
        )


def _names(resolved: ResolvedTemplate, wish: ConnectionWish) -> tuple[str, str]:
    return resolved.rooms[wish.rooms[0]].name, resolved.rooms[wish.rooms[1]].name


def _ways(kind: str, count: int) -> str:
    return f"{count} {kind.lower()}{'s' if count > 1 else ''}"


def _doors(resolved: ResolvedTemplate, passages: Sequence[Passage], doors: Sequence[Door]) -> Iterator[Wish]:
    if resolved.doors is None:
        return
    for (low, high), wished in resolved.doors.wished:
        pair = (resolved.rooms[low].name, resolved.rooms[high].name)
        for door in (each for each in doors if set(passages[each.passage].rooms) == set(pair)):
            yield Wish(
                kind="door",
                subject=" - ".join(pair),
                wished="random" if wished == "Random" else f"{wished:g} % open",
                found=f"{door.open_percent:g} % open",
                met=wished in ("Random", door.open_percent),
            )


def certify(
    resolved: ResolvedTemplate,
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
        resolved: What the template asks for.
        rooms: The rooms, in the template's order.
        passages: The ways between them.
        walls: All walls.
        furniture: All furniture.
        doors: All doors.
        surveyed: The floors, where they are known already.
    """
    clear = surveyed or survey(rooms, passages, walls, furniture, doors, radius_m=resolved.robot_radius_m)
    floors = [room_box(room) for room in rooms]
    figures = tuple(_figures(resolved, clear.opened, rooms))
    reachable, as_set = _reachable_radii(clear, rooms, passages)
    leaves = [door.leaf for door in doors]
    solids = [*[solid for piece in furniture for solid in piece.solids], *leaves, *walls]
    rows = solid_rows(solids)
    return Certificate(
        origin_clear_radius_m=rounded(distance_to_origin(solids, rows)),
        guaranteed_robot_radius_m=rounded(resolved.robot_radius_m),
        reachable_robot_radius_m=rounded(reachable),
        doors_as_set_robot_radius_m=rounded(as_set),
        narrowest_passage_m=rounded(narrowest_passage(passages, doors)),
        free_floor_share=rounded(_free_share(clear.opened, floors)),
        area_error_mean=rounded(_area_error_mean(resolved, floors)),
        overlaps=count_overlaps(furniture, walls, leaves, rows),
        rooms=figures,
        wishes=weigh_wishes(resolved, rooms, passages, furniture, doors, figures=figures, outline_m=_outline(floors)),
    )


def _outline(floors: Sequence[Box]) -> tuple[float, float]:
    """Returns the extents of the footprint along x and y (metres)."""
    box = bounding_box(floors).grown(WALL_M)
    return box.width, box.height


def _area_error_mean(resolved: ResolvedTemplate, floors: Sequence[Box]) -> float:
    """Returns by what share rooms miss their wished areas on average."""
    errors = [abs(floor.area - wish.area_m2) / wish.area_m2 for floor, wish in zip(floors, resolved.rooms, strict=True)]
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


def _figures(resolved: ResolvedTemplate, grid: ExactGrid, rooms: Sequence[Room]) -> Iterator[RoomFigures]:
    reached = grid.reached(resolved.robot_radius_m)
    for room in rooms:
        floor = room_box(room)
        yield RoomFigures(
            room=room.name,
            area_m2=rounded(floor.area),
            free_floor_share=rounded(_free_share(grid, [floor])),
            reached_share=rounded(connected_share(reached, grid, floor, resolved.robot_radius_m)),
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


def _reachable_radius(grid: ExactGrid, rooms: Sequence[Room], passages: Sequence[Passage]) -> float:
    """Returns the largest radius (whole centimetres) with which every room is reached; 0 for none.

    Most often the passages alone decide it, or something a little narrower does. So what they let through is tried
    first, then less and less, each step twice as long as the one before; what is left between two steps is halved.
    """
    floors = [room_box(room) for room in rooms]
    middle = math.floor(_most_through(grid, rooms, passages) / _RADIUS_STEP_M + EPSILON_M)
    low, high, down = 0, middle + 1, 1
    while high - low > 1:
        holds = _reaches_all(grid, floors, middle * _RADIUS_STEP_M)
        low, high = (middle, high) if holds else (low, middle)
        middle = (low + high) // 2 if low else max(middle - down, 1)
        down *= 2
    return low * _RADIUS_STEP_M


def _most_through(grid: ExactGrid, rooms: Sequence[Room], passages: Sequence[Passage]) -> float:
    """Returns a radius that no robot exceeds which gets into every room: each has to be entered by a passage of its."""
    through = [grid.widest_radius(_threshold(passage)) for passage in passages]
    return max(most_through(rooms, passages, through), 0.0)


def _reaches_all(grid: ExactGrid, floors: Sequence[Box], radius_m: float) -> bool:
    reached = grid.reached(radius_m)
    return all(reaches_room(reached, grid, floor, radius_m) for floor in floors)


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


def _free_share(grid: ExactGrid, floors: Sequence[Box]) -> float:
    covered = [grid.covered[grid.cells(floor)] for floor in floors]
    return 1.0 - sum(int(cells.sum()) for cells in covered) / sum(cells.size for cells in covered)


def keep_furniture(world: World, kept: Collection[str], template: TemplateBody | None) -> World:
    """Returns a world with some of its furniture, with a map and a certificate of its own.

    The certificate is measured on the geometry that is left. Beside the template's wishes it has one about the pieces
    that were taken out, which is not met: nobody shall take the world for one that was generated so.

    Args:
        world: Any world.
        kept: Names of the pieces to keep.
        template: What the world was made from; None where that is not known. Wishes about furniture are then left out.
    """
    furniture = tuple(piece for piece in world.furniture if piece.name in kept)
    radius_m = world.certificate.guaranteed_robot_radius_m
    surveyed = survey(world.rooms, world.passages, world.walls, furniture, world.doors, radius_m=radius_m)
    measured = certify(
        _brief_as_built(world) if template is None else resolve_template(template, radius_m),
        world.rooms,
        world.passages,
        walls=world.walls,
        furniture=furniture,
        doors=world.doors,
        surveyed=surveyed,
    )
    certificate = measured if template is not None else _keep_other_wishes(measured, world.certificate)
    taken = Wish(
        kind="furniture",
        subject="all rooms",
        wished=f"{len(world.furniture)} as generated",
        found=f"{len(furniture)} left",
        met=len(furniture) == len(world.furniture),
    )
    return world.model_copy(
        update={
            "generator": world.generator if world.generator.endswith(SHRUNK) else f"{world.generator}-{SHRUNK}",
            "furniture": furniture,
            "map": surveyed.as_set.occupancy(),
            "certificate": certificate.model_copy(update={"wishes": (*certificate.wishes, taken)}),
        }
    )


def _keep_other_wishes(measured: Certificate, before: Certificate) -> Certificate:
    """Returns what was measured, with what an earlier certificate says of wishes that furniture has no part in."""
    wishes = tuple(wish for wish in before.wishes if wish.kind not in _ABOUT_FURNITURE)
    return measured.model_copy(update={"area_error_mean": before.area_error_mean, "wishes": wishes})


def _brief_as_built(world: World) -> ResolvedTemplate:
    """Returns a template that asks for the rooms as they are, to measure with where nobody knows what was asked for."""
    return ResolvedTemplate(
        footprint_aspect=1.0,
        ceiling_height_m=world.ceiling_height_m,
        rooms=tuple(
            RoomWish(
                name=room.name,
                type=room.type,
                area_m2=(room.floor.x_max_m - room.floor.x_min_m) * (room.floor.y_max_m - room.floor.y_min_m),
                aspect=1.0,
                floorings=(),
                walls=(),
                furniture=None,
                density="Moderate",
            )
            for room in world.rooms
        ),
        connections=(),
        robot_radius_m=world.certificate.guaranteed_robot_radius_m,
    )
