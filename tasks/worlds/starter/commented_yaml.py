"""A template as YAML, with a comment where a key comes for the first time."""

import json
import re

from pydantic import JsonValue

from tasks.worlds.starter.starter_template import Body

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
_PLAIN_TEXT = re.compile(r"(?!(?:true|false|null|yes|no)$)[A-Za-z][A-Za-z0-9_. -]*\Z", re.IGNORECASE)
_WIDTH = 100


def commented_yaml(body: Body) -> str:
    """Returns a body as YAML with a comment where a key comes for the first time."""
    head = "# A WorldForge template. Every key, with its bounds: docs/reference/templates.md\n"
    return head + "\n".join(_lines(body, 0, set())) + "\n"


def _lines(data: Body, indent: int, told: set[str]) -> list[str]:
    """Returns the lines of an object, with each comment once."""
    space, lines = " " * indent, list[str]()
    for key, value in data.items():
        if key in _COMMENTS and key not in told:
            lines.append(f"{space}# {_COMMENTS[key]}")
            told.add(key)
        flow = _flow(value)
        if indent + len(key) + len(flow) <= _WIDTH and not _has_comments(value, told):
            lines.append(f"{space}{key}: {flow}")
        elif isinstance(value, dict):
            lines += [f"{space}{key}:", *_lines(value, indent + 2, told)]
        else:
            lines += [f"{space}{key}:", *_items(value, indent, told)]
    return lines


def _items(value: JsonValue, indent: int, told: set[str]) -> list[str]:
    """Returns the lines of a list, its dashes below the key."""
    lines: list[str] = []
    for item in value if isinstance(value, list) else ():
        if isinstance(item, dict):
            inside = _lines(item, indent + 2, told)
            first = next(number for number, line in enumerate(inside) if not line.lstrip().startswith("#"))
            lines += [*inside[:first], f"{' ' * indent}- {inside[first].lstrip()}", *inside[first + 1 :]]
        else:
            lines.append(f"{' ' * indent}- {_flow(item)}")
    return lines


def _has_comments(value: JsonValue, told: set[str]) -> bool:
    if isinstance(value, list):
        return any(_has_comments(item, told) for item in value)
    if not isinstance(value, dict):
        return False
    return any((key in _COMMENTS and key not in told) or _has_comments(below, told) for key, below in value.items())


def _flow(value: JsonValue) -> str:
    """Returns a value on one line."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key}: {_flow(below)}' for key, below in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_flow, value))}]"
    return value if isinstance(value, str) and _PLAIN_TEXT.match(value) else json.dumps(value)
