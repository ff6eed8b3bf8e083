"""Resolved templates for the tests of floor plans: plain ones, random ones, and what a plan is made of."""

from itertools import combinations

from hypothesis import strategies as st

from specs.data.world import RoomType
from tasks.worlds.resolved_template import (
    ROBOT_RADIUS_M,
    ConnectionWish,
    DoorWishes,
    PassageKind,
    ResolvedTemplate,
    RoomWish,
)
from tests.worlds.templates import ROOM_TYPES

_sides = st.one_of(st.just(1.0), st.floats(1.0, 4.0))
_aspects = st.tuples(_sides, _sides).map(lambda sides: sides[0] / sides[1])


def wish(name: str, kind: RoomType = "Living", area_m2: float = 20.0, aspect: float = 1.0) -> RoomWish:
    """Returns a room that is wished without any surfaces or furniture."""
    return RoomWish(name, kind, area_m2, aspect, (), (), None, "Moderate")


def resolved(
    *rooms: RoomWish,
    connections: tuple[tuple[int, int], ...] = (),
    openings: tuple[tuple[int, int], ...] = (),
    footprint: float = 1.0,
    radius_m: float = ROBOT_RADIUS_M,
    doors: bool = False,
) -> ResolvedTemplate:
    """Returns a template of these rooms, connected by doorways and openings between rooms by index."""
    wishes = [ConnectionWish(pair, "Doorway") for pair in connections]
    wishes += [ConnectionWish(pair, "Opening") for pair in openings]
    return ResolvedTemplate(
        footprint_aspect=footprint,
        ceiling_height_m=2.7,
        rooms=rooms,
        connections=tuple(wishes),
        doors=DoorWishes() if doors else None,
        robot_radius_m=radius_m,
    )


def flat() -> ResolvedTemplate:
    """Returns a flat of six rooms around a hall."""
    rooms = (
        wish("Hall", "Hallway", 12.0, 2.5),
        wish("Living", "Living", 28.0, 1.3),
        wish("Kitchen", "Kitchen", 14.0),
        wish("Bed 1", "Bedroom", 20.0),
        wish("Bed 2", "Bedroom", 14.0),
        wish("Bath", "Bathroom", 10.0),
    )
    return resolved(*rooms, connections=((0, 3), (0, 4), (0, 5)), openings=((0, 1), (1, 2)))


@st.composite
def resolved_templates(draw: st.DrawFn) -> ResolvedTemplate:
    """Returns a random template: any rooms and connections, any robot, with doors or without."""
    count = draw(st.integers(1, 6))
    rooms = tuple(
        wish(f"Room {n}", draw(st.sampled_from(ROOM_TYPES)), draw(st.floats(10.0, 60.0)), draw(_aspects))
        for n in range(count)
    )
    connections: list[ConnectionWish] = []
    for pair in draw(st.lists(st.sampled_from(list(combinations(range(count), 2)) or [(0, 0)]), unique=True)):
        kind: PassageKind = draw(st.sampled_from(("Doorway", "Opening")))
        times = draw(st.integers(1, 3)) if kind == "Doorway" else 1
        taken = [room for each in connections for room in each.rooms]
        if count > 1 and all(taken.count(room) + times <= 4 for room in pair) and len(connections) + times <= 12:
            connections += [ConnectionWish(pair, kind)] * times
    return ResolvedTemplate(
        footprint_aspect=draw(_aspects),
        ceiling_height_m=2.7,
        rooms=rooms,
        connections=tuple(connections),
        doors=draw(st.sampled_from((None, DoorWishes()))),
        robot_radius_m=draw(st.floats(0.05, 0.6)),
    )
