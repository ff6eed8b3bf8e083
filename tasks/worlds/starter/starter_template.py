"""A template to begin with: complete, and valid as it stands."""

import json
from collections.abc import Sequence
from typing import Literal

from pydantic import JsonValue

from specs.data.world import RoomType
from tasks.worlds.furnishing.programme import PROGRAMMES

STARTER_ROOMS: tuple[RoomType, ...] = ("Hallway", "Living", "Kitchen", "Bedroom", "Bathroom")
Version = Literal["1", "2"]
Body = dict[str, JsonValue]

_NAMES: dict[RoomType, str] = {
    "Living": "Living room",
    "Dining": "Dining room",
    "Hallway": "Hall",
}
_AREAS_M2: dict[RoomType, int] = {
    "Bedroom": 16,
    "Bathroom": 10,
    "Living": 28,
    "Dining": 18,
    "Kitchen": 14,
    "Hallway": 14,
    "Closet": 10,
}
# From the most public: ways through a home lead over the first of these that it has.
_PUBLIC: tuple[RoomType, ...] = ("Hallway", "Living", "Dining", "Kitchen", "Bedroom", "Closet", "Bathroom")
_WAYS_OF_A_ROOM = 4
_AJAR_PERCENT = 95
"""A robot of 0.25 m, for which worlds are made, still gets through."""
_WET: tuple[RoomType, ...] = ("Bathroom", "Kitchen")


def starter_template(rooms: Sequence[RoomType], version: Version) -> Body:
    """Returns the body of a template with these rooms, every part of it filled in.

    Args:
        rooms: From 1 to 6.
        version: Of the template.
    """
    names = _room_names(rooms)
    interior = _interior(rooms, names, version)
    plan: Body = {
        "Footprint": {"DesiredAspectRatio": {"x": 1, "y": 1}},
        "Ceiling": {"Height": 2.7},
        "Rooms": [_room(kind, name) for kind, name in zip(rooms, names, strict=True)],
        "DesiredConnections": [
            {"Location": [names[one], names[other]], "ConnectionType": _way(rooms[one], rooms[other])}
            for one, other in _ways(rooms)
        ],
    }
    return {"Version": version, "Buildings": [{"Floors": [{"Floorplan": plan, "Interior": interior}]}]}


def starter_json(body: Body) -> str:
    """Returns a body as JSON, which has no comments."""
    return json.dumps(body, indent=2) + "\n"


def _room_names(rooms: Sequence[RoomType]) -> list[str]:
    names: list[str] = []
    for number, kind in enumerate(rooms):
        before = list(rooms[:number]).count(kind)
        name = _NAMES.get(kind, kind)
        names.append(f"{name} {before + 1}" if before else name)
    return names


def _room(kind: RoomType, name: str) -> Body:
    return {
        "Type": kind,
        "Name": name,
        "DesiredShape": {"Area": _AREAS_M2[kind], "AspectRatio": {"x": 1, "y": 1}},
    }


def _ways(rooms: Sequence[RoomType]) -> list[tuple[int, int]]:
    """Returns a way from each room to a more public one that has a way left."""
    order = sorted(range(len(rooms)), key=lambda room: _PUBLIC.index(rooms[room]))
    ways: list[tuple[int, int]] = []
    for place, room in enumerate(order[1:], start=1):
        taken = [end for way in ways for end in way]
        hub = next(each for each in order[:place] if taken.count(each) < _WAYS_OF_A_ROOM)
        ways.append((hub, room))
    return ways


def _way(one: RoomType, other: RoomType) -> str:
    return "Opening" if {one, other} in ({"Living", "Dining"}, {"Dining", "Kitchen"}) else "Doorway"


def _interior(rooms: Sequence[RoomType], names: Sequence[str], version: Version) -> Body:
    kinds: list[RoomType] = list(dict.fromkeys(rooms))
    wet: list[RoomType] = [kind for kind in kinds if kind in _WET]
    dry: list[RoomType] = [kind for kind in kinds if kind not in _WET]
    floors = [_materials("Tiled floors", wet, "Tiles"), _materials("Wooden floors", dry, "Floorboards", "Parquetry")]
    everywhere: JsonValue = "Target.All" if version == "2" else {"RoomTypes": [*kinds]}
    largest = max(range(len(rooms)), key=lambda room: _AREAS_M2[rooms[room]])
    interior: Body = {
        "Flooring": {"MaterialSets": [each for each in floors if each]},
        "Walls": {
            "MaterialSets": [
                {"Name": "Walls", "TargetSet": everywhere, "SampleSet": {"MaterialTypes": ["Wall paint", "Wallpaper"]}}
            ]
        },
        "Furniture": {"FurnitureArrangements": [_arrangement(rooms[largest], names[largest])]},
    }
    if version == "2" and len(rooms) > 1:
        interior["Doorways"] = {"DoorwaySets": [_doors(kinds)]}
    return interior


def _materials(name: str, kinds: Sequence[RoomType], *materials: str) -> Body:
    if not kinds:
        return {}
    return {"Name": name, "TargetSet": {"RoomTypes": [*kinds]}, "SampleSet": {"MaterialTypes": [*materials]}}


def _arrangement(kind: RoomType, room: str) -> Body:
    programme = PROGRAMMES[kind]
    listed = [*(each for choice in programme.essential for each in choice), *programme.likely]
    return {
        "Name": f"Furniture of the {room.lower()}",
        "TargetSet": {"RoomNames": [room]},
        "SampleSet": {"ModelTypes": [*dict.fromkeys(listed)]},
        "DesiredSpatialDensity": "Moderate",
    }


def _doors(kinds: Sequence[RoomType]) -> Body:
    """Returns the doors of the most private rooms, a little less than fully open."""
    private = max(kinds, key=_PUBLIC.index)
    ends: Body = {"From": {"RoomTypes": [private]}, "To": {"RoomTypes": [*kinds]}}
    return {
        "Name": "Doors ajar",
        "TargetSet": ends,
        "Door": {"InitialState": {"OpenPosition": {"Percent": _AJAR_PERCENT}}},
    }
