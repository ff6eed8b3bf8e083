"""Which doors a template of version 2 wants in which doorways.

A set that names rooms beats one that names their types, which beats one for the whole home; of two at the same level
the first listed wins, as for all other sets. A doorway that no set names gets a door that stands fully open.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from specs.template import FloorplanRoom
from specs.template_interior import (
    TARGET_ALL,
    InteriorDoorways,
    InteriorDoorwaySet,
    RoomNameList,
    RoomPairTargetFilter,
    RoomTypeList,
)

Opening = float | Literal["Random"]
"""Percent of a quarter turn, or drawn anew for each world."""
FULLY_OPEN = 100.0


@dataclass(frozen=True)
class DoorWishes:
    """How far doors stand open.

    Attributes:
        wished: The opening by pair of rooms (indices into the brief's rooms, lower first), where a set names the pair.
    """

    wished: tuple[tuple[tuple[int, int], Opening], ...] = ()

    def opening(self, rooms: tuple[int, int]) -> Opening:
        """Returns how far the doors between two rooms stand open."""
        return dict(self.wished).get(rooms, FULLY_OPEN)


def door_wishes(doorways: InteriorDoorways | None, rooms: Sequence[FloorplanRoom]) -> DoorWishes | None:
    """Returns the doors that a template wants, None when its doorways have no doors."""
    if doorways is None:
        return None
    ranked = sorted(doorways.DoorwaySets, key=_rank)  # stable: the first listed stays first
    wished: dict[tuple[int, int], Opening] = {}
    for each in ranked:
        opening = FULLY_OPEN if each.Door is None else each.Door.InitialState.OpenPosition.Percent
        for low in range(len(rooms)):
            for high in range(low + 1, len(rooms)):
                if _joins(each, rooms[low], rooms[high]):
                    wished.setdefault((low, high), opening)
    return DoorWishes(tuple(sorted(wished.items(), key=lambda item: item[0])))


def _rank(doorways: InteriorDoorwaySet) -> int:
    """Returns 0 for the most specific: both ends by name, then one, then by type, then the whole home."""
    target = doorways.TargetSet
    if not isinstance(target, RoomPairTargetFilter):
        return 3
    return sum(isinstance(end, RoomTypeList) for end in (target.From, target.To))


def _joins(doorways: InteriorDoorwaySet, one: FloorplanRoom, other: FloorplanRoom) -> bool:
    target = doorways.TargetSet
    if not isinstance(target, RoomPairTargetFilter):
        return target == TARGET_ALL
    return (_holds(target.From, one) and _holds(target.To, other)) or (
        _holds(target.From, other) and _holds(target.To, one)
    )


def _holds(rooms: RoomNameList | RoomTypeList, room: FloorplanRoom) -> bool:
    return room.Name in rooms.RoomNames if isinstance(rooms, RoomNameList) else room.Type in rooms.RoomTypes
