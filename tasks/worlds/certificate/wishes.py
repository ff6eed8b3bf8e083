"""What became of each wish of the template, measured on the finished world.

What a template has where its author said nothing is no wish: proportions of 1:1, a room that is 20 m2 and 1:1, and
moderate density beside a list of furniture. Whether these were written or filled in cannot be told: nobody can write a
room's area without its proportions, RoboMaker's samples write all of it, and writing it gives the same worlds.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

from specs.data.world import Door, Furniture, Passage, Room, RoomFigures, Wish
from tasks.worlds.brief import DEFAULT_AREA_M2, FREE_FLOOR, Brief, ConnectionWish, RoomWish
from tasks.worlds.geometry.boxes import rounded
from tasks.worlds.materials import FLOORINGS, WALLS, SurfaceMaterial, known_name

AREA_TOLERANCE = 0.03
ASPECT_TOLERANCE = 0.25
_SQUARE = 1.0


def weigh_wishes(
    brief: Brief,
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
        brief: What the template asks for.
        rooms: The finished rooms, in the brief's order.
        passages: The ways between them.
        furniture: All furniture.
        doors: All doors.
        figures: The certificate's figures, by room.
        outline_m: The footprint's extents along x and y.
    """
    by_room: list[Iterator[Wish]] = []
    for wish, room, figure in zip(brief.rooms, rooms, figures, strict=True):
        pieces = [piece.model_type for piece in furniture if piece.room == wish.name]
        by_room += [_shape(wish, room), _surfaces(wish, room), _furnishing(wish, pieces, figure)]
    footprint = _aspect("footprint", "footprint", outline_m, brief.footprint_aspect)
    return (*footprint, *chain(*by_room), *_connections(brief, passages), *_doors(brief, passages, doors))


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


def _connections(brief: Brief, passages: Sequence[Passage]) -> Iterator[Wish]:
    built = Counter((frozenset(passage.rooms), passage.kind) for passage in passages if passage.desired)
    for wish, count in Counter(brief.connections).items():
        pair = _names(brief, wish)
        found = {kind: built[frozenset(pair), kind] for kind in ("Doorway", "Opening")}
        yield Wish(
            kind="connection",
            subject=" - ".join(pair),
            wished=_ways(wish.kind, count),
            found=" and ".join(_ways(kind, number) for kind, number in found.items() if number) or "none",
            met=found[wish.kind] >= count,
        )


def _names(brief: Brief, wish: ConnectionWish) -> tuple[str, str]:
    return brief.rooms[wish.rooms[0]].name, brief.rooms[wish.rooms[1]].name


def _ways(kind: str, count: int) -> str:
    return f"{count} {kind.lower()}{'s' if count > 1 else ''}"


def _doors(brief: Brief, passages: Sequence[Passage], doors: Sequence[Door]) -> Iterator[Wish]:
    if brief.doors is None:
        return
    for (low, high), wished in brief.doors.wished:
        pair = (brief.rooms[low].name, brief.rooms[high].name)
        for door in (each for each in doors if set(passages[each.passage].rooms) == set(pair)):
            yield Wish(
                kind="door",
                subject=" - ".join(pair),
                wished="random" if wished == "Random" else f"{wished:g} % open",
                found=f"{door.open_percent:g} % open",
                met=wished in ("Random", door.open_percent),
            )
