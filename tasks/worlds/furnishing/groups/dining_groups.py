"""Tables with chairs pushed under them."""

from collections.abc import Iterator

from tasks.worlds.furnishing.groups.group import FurnitureGroup, Member, Zone
from tasks.worlds.furnishing.room_context import RoomContext
from tasks.worlds.furniture.furniture_type import Taste, TypeName
from tasks.worlds.furniture.primitives import Size
from tasks.worlds.geometry.boxes import Box

_CHAIR: Size = (0.45, 0.5, 0.9)
_TUCK_M = 0.22
_LEGS_M = 0.09
_SEAT_M = 0.6  # Neufert: of table edge for each diner
_END_SEAT_M = 1.55
_RISE_M = 0.75
_MOST = 6
_SMALL_ROOM_M2 = 16.0


def table_groups(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields tables to try: in the room with chairs all around, then with one end or side at a wall, then alone."""
    sizes = setting.sizes(kind)
    turns = _long_way(setting)
    for size in sizes:
        yield _free_standing(setting, Member(kind, size), turns)
    for size in sizes[-2:]:
        yield _end_at_wall(setting, Member(kind, size, quarter=1))
        yield _side_at_wall(setting, Member(kind, size))
    small = Member(kind, setting.smallest(kind))
    yield _side_at_wall(setting, small)
    if setting.listed is not None:
        yield FurnitureGroup((small,), ())


def _long_way(setting: RoomContext) -> tuple[int, ...]:
    """Returns the ways to turn a table so that it lies along the room, or any in a square one."""
    floor = setting.scene.floor
    if max(floor.width, floor.height) < 1.15 * min(floor.width, floor.height):
        return (0, 1)
    return (0,) if floor.width > floor.height else (1,)


def _free_standing(setting: RoomContext, table: Member, turns: tuple[int, ...]) -> FurnitureGroup:
    """Returns a table in the room, with chairs all around."""
    size = table.size
    x, y = size[0] / 2, size[1] / 2
    chairs = _long_side(setting, size, -1) + _long_side(setting, size, 1)
    if size[0] >= _END_SEAT_M or size[0] == size[1]:
        chairs += [_chair(setting, size, (side * x, 0.0), side % 4) for side in (-1, 1)]
    most = 4 if setting.area_m2 < _SMALL_ROOM_M2 else _MOST
    around = max(_RISE_M, setting.scene.way_m)
    zone = Zone(Box(-x - around, -y - around, x + around, y + around))
    # The first table of a room takes its middle.
    middle = 1.2 if setting.scene.count(table.kind) == 0 else 0.0
    return FurnitureGroup(
        (table, *_keep_allowed(setting, chairs[:most])),
        (zone,),
        "center",
        Taste(middle=middle, away=0.3, chance=0.4),
        turns,
    )


def _side_at_wall(setting: RoomContext, table: Member) -> FurnitureGroup:
    """Returns a table with a long side at a wall, and chairs along the other."""
    x, y = table.size[0] / 2, table.size[1] / 2
    chairs = _long_side(setting, table.size, 1)
    zone = Zone(Box(-x, y, x, y + max(_RISE_M, setting.scene.way_m)))
    return FurnitureGroup((table, *_keep_allowed(setting, chairs)), (zone,), taste=Taste(window=0.6, corner=0.2))


def _end_at_wall(setting: RoomContext, table: Member) -> FurnitureGroup:
    """Returns a table, a quarter turned, whose long side runs from a wall into the room, and chairs along both."""
    x, y = table.size[1] / 2, table.size[0] / 2
    rise = max(_RISE_M, setting.scene.way_m)
    chairs = [_turn_chair(chair) for side in (-1, 1) for chair in _long_side(setting, table.size, side)]
    zone = Zone(Box(-x - rise, -y, x + rise, y))
    front = Zone(Box(-x, y, x, y + setting.scene.way_m))
    return FurnitureGroup((table, *_keep_allowed(setting, chairs)), (zone, front), taste=Taste(window=0.4, middle=0.4))


def _long_side(setting: RoomContext, size: Size, side: int) -> list[Member]:
    """Returns the chairs along one long side (-1 at the back, 1 in front), as many as have 0.6 m each."""
    usable = size[0] - 2 * _LEGS_M
    if size[0] == size[1]:
        usable = min(usable, _SEAT_M)
    count = min(max(1, int((usable + 0.04) / _SEAT_M)), 3)
    pitch = usable / count
    return [
        _chair(setting, size, (round(-usable / 2 + (n + 0.5) * pitch, 3), side * size[1] / 2), 0 if side < 0 else 2)
        for n in range(count)
    ]


def _chair(setting: RoomContext, table: Size, edge: tuple[float, float], quarter: int) -> Member:
    """Returns a chair that faces a table from a point of its edge, and is pushed under it more or less."""
    tuck = round(_TUCK_M - 0.04 * int(3 * float(setting.rng.random())), 2)
    if table[0] == table[1]:
        tuck = min(tuck, round(table[0] / 2 - _CHAIR[0] / 2 - 0.02, 3))  # or diners at the corner would touch
    out = round(_CHAIR[1] / 2 - tuck, 3)
    # Facings 0 to 3 look along +y, -x, -y, +x; the chair stands out of the table the other way.
    dx, dy = ((0.0, -out), (out, 0.0), (0.0, out), (-out, 0.0))[quarter]
    return Member("DiningChairs", _CHAIR, (edge[0] + dx, edge[1] + dy), quarter, needed=False, worth=0.5, under=tuck)


def _turn_chair(chair: Member) -> Member:
    x, y = chair.at
    return chair._replace(at=(-y, x), quarter=(chair.quarter + 1) % 4)


def _keep_allowed(setting: RoomContext, chairs: list[Member]) -> list[Member]:
    """Returns the chairs that a list leaves; a table without any would be a poor one, so the first is needed."""
    if not setting.allows("DiningChairs"):
        return []
    return [chairs[0]._replace(needed=True), *chairs[1:]]
