"""A template to begin with, for any rooms: complete, valid as it stands, as JSON or as YAML with comments."""

import json
import re
from collections.abc import Sequence
from typing import Literal

from pydantic import JsonValue

from specs.data.world import RoomType
from tasks.worlds.furniture.catalogue import ROOM_DEFAULTS

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
_PLAIN_TEXT = re.compile(r"(?!(?:true|false|null|yes|no)$)[A-Za-z][A-Za-z0-9_. -]*\Z", re.IGNORECASE)
_WIDTH = 100


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
    defaults = ROOM_DEFAULTS[kind]
    listed = [*(each for choice in defaults.essential for each in choice), *defaults.likely]
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


_COMMENTS = {
    "Version": '"1" or "2"; 2 has doors, and Target.All.',
    "Buildings": "One building with one floor.",
    "Footprint": "Proportions of the whole home, x to y, each from 1 to 4. 1 to 1 leaves them to Simyard.",
    "Ceiling": "Metres, from 2.4 to 4.0.",
    "Rooms": "From 1 to 6, each with a name of its own. Bedroom, Bathroom, Living, Dining, Kitchen, Hallway, Closet.",
    "Area": "Square metres, from 10 to 300.",
    "AspectRatio": "Extent along x to extent along y, each from 1 to 4. 1 to 1 leaves it to Simyard.",
    "DesiredConnections": "Wished ways, at most 4 of a room: Doorway, or Opening (a wide gap). More come where needed.",
    "Interior": "Each set is for rooms by RoomNames or by RoomTypes; a set that names a room wins.",
    "Flooring": "Carpet, Concrete, Floorboards, Linoleum, Parquetry, Tiles: one of the list is drawn.",
    "Walls": "Brick, Concrete, Stone, Tiles, Wood panels, Wall paint, Wallpaper.",
    "Furniture": "Other rooms get what suits their type. An empty list of ModelTypes leaves a room empty.",
    "DesiredSpatialDensity": "Sparse, Moderate or Dense.",
    "Doorways": "Hinged doors: Percent from 0 (shut) to 100 (fully open), or Random in each world.",
}


def commented_yaml(body: Body) -> str:
    """Returns a body as YAML with a comment where a key comes for the first time."""
    head = "# A WorldForge template. Every key, with its bounds: docs/reference/templates.md\n"
    return head + "\n".join(_lines(body, 0, set())) + "\n"


def _lines(data: Body, indent: int, commented: set[str]) -> list[str]:
    """Returns the lines of an object, with each comment once."""
    space, lines = " " * indent, list[str]()
    for key, value in data.items():
        if key in _COMMENTS and key not in commented:
            lines.append(f"{space}# {_COMMENTS[key]}")
            commented.add(key)
        flow = _flow(value)
        if indent + len(key) + len(flow) <= _WIDTH and not _has_comments(value, commented):
            lines.append(f"{space}{key}: {flow}")
        elif isinstance(value, dict):
            lines += [f"{space}{key}:", *_lines(value, indent + 2, commented)]
        else:
            lines += [f"{space}{key}:", *_items(value, indent, commented)]
    return lines


def _items(value: JsonValue, indent: int, commented: set[str]) -> list[str]:
    """Returns the lines of a list, its dashes below the key."""
    lines: list[str] = []
    for item in value if isinstance(value, list) else ():
        if isinstance(item, dict):
            inside = _lines(item, indent + 2, commented)
            first = next(number for number, line in enumerate(inside) if not line.lstrip().startswith("#"))
            lines += [*inside[:first], f"{' ' * indent}- {inside[first].lstrip()}", *inside[first + 1 :]]
        else:
            lines.append(f"{' ' * indent}- {_flow(item)}")
    return lines


def _has_comments(value: JsonValue, commented: set[str]) -> bool:
    if isinstance(value, list):
        return any(_has_comments(item, commented) for item in value)
    if not isinstance(value, dict):
        return False
    return any(
        (key in _COMMENTS and key not in commented) or _has_comments(below, commented) for key, below in value.items()
    )


def _flow(value: JsonValue) -> str:
    """Returns a value on one line."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}: {_flow(below)}' for key, below in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_flow, value))}]"
    return value if isinstance(value, str) and _PLAIN_TEXT.match(value) else json.dumps(value)
