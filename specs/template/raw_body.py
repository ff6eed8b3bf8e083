"""A template body before it is checked: its forms in RoboMaker's documents, and the rules of RoboMaker's prose.

The rules look at raw data, which may be wrong in other ways too.
"""

import json
from collections import Counter
from collections.abc import Iterator
from typing import Any, cast

from specs.base import Spec
from specs.rules import Finding, Location, broken, items, part
from specs.template.interior import TARGET_ALL

_WRAPPER_KEY = "templateBody"
_VERSION_2_ROOM = {
    "Type": "Living",
    "Name": "My_Living_Room",
    "OriginalName": "My Living Room",
    "DesiredShape": {"Area": 20.0, "AspectRatio": {"x": 1.0, "y": 1.0}},
}


def bare_body(data: object) -> tuple[object, Location]:
    """Returns the body in raw data and where in the data it lies.

    Raises:
        PydanticCustomError: For text that is not JSON.
    """
    if isinstance(data, str):
        try:
            return json.loads(data), ("<json>",)
        except (json.JSONDecodeError, RecursionError) as exc:
            raise broken(f"a template body: an object, or the same as JSON text; {_why_no_json(exc)}") from exc
    for key in (_WRAPPER_KEY, "name"):
        inner = part(data, key)
        if isinstance(inner, dict) or (key == _WRAPPER_KEY and isinstance(inner, str)):
            return inner, (key,)
    return data, ()


def _why_no_json(exc: json.JSONDecodeError | RecursionError) -> str:
    if isinstance(exc, RecursionError):
        return "this one is nested too deep"
    return f"this one is no JSON at line {exc.lineno}, column {exc.colno}: {exc.msg}"


def with_version_2_defaults(data: object) -> object:
    """Returns the raw body with the defaults that differ between the versions filled in; the input is not changed."""
    if not isinstance(data, dict) or part(data, "Version") != "2":
        return data
    body = cast("dict[str, object]", data)
    building = _first(body.get("Buildings", [{}]))
    floor = _first(building.get("Floors", [{}])) if building is not None else None
    if building is None or floor is None:
        return body
    filled = {
        **floor,
        "Floorplan": _default(floor.get("Floorplan", {}), "Rooms", [_VERSION_2_ROOM]),
        "Interior": _default(floor.get("Interior", {}), "Doorways", {}),
    }
    return {**body, "Buildings": [{**building, "Floors": [filled]}]}


def _first(data: object) -> dict[str, object] | None:
    found = items(data)
    one = found[0] if len(found) == 1 else None
    return cast("dict[str, object]", one) if isinstance(one, dict) else None


def _default(data: object, key: str, value: object) -> object:
    return {key: value, **cast("dict[str, object]", data)} if isinstance(data, dict) else data


MAX_CONNECTIONS_OF_ROOM = 4

Connection = tuple[int, tuple[str, str], object]
"""Its number, the names at its ends, and its type."""


def connections_of(data: object) -> Iterator[Connection]:
    """Yields the connections that can be understood: number, the two ends, and the type."""
    for number, connection in enumerate(items(data)):
        ends = [end for end in items(part(connection, "Location")) if isinstance(end, str)]
        if len(ends) == 2:
            yield number, (ends[0], ends[1]), part(connection, "ConnectionType")


def unknown_rooms(connections: list[Connection], names: list[str]) -> Iterator[Finding]:
    """Yields ends of connections that are no room, and connections of a room with itself."""
    known = ", ".join(dict.fromkeys(names))
    for number, ends, _ in connections:
        for side, end in enumerate(ends):
            if end not in names:
                yield Finding(("DesiredConnections", number, "Location", side), end, f"a room of Rooms: {known}")
        if ends[0] == ends[1]:
            yield Finding(("DesiredConnections", number, "Location"), list(ends), "two different rooms")


def contradictions(connections: list[Connection]) -> Iterator[Finding]:
    """Yields pairs of rooms with an Opening and something else (docs/reference/robomaker.md, section 6)."""
    first: dict[frozenset[str], tuple[int, object]] = {}
    for number, ends, kind in connections:
        earlier, earlier_kind = first.setdefault(frozenset(ends), (number, kind))
        if earlier == number or kind not in ("Doorway", "Opening") or earlier_kind not in ("Doorway", "Opening"):
            continue
        pair = f"{ends[0]} and {ends[1]}; DesiredConnections[{earlier}] is {earlier_kind}"
        if "Opening" in (kind, earlier_kind):
            words = "one Opening" if kind == earlier_kind else "either one Opening or Doorways"
            yield Finding(("DesiredConnections", number, "ConnectionType"), kind, f"{words} between {pair}")


def crowded_rooms(connections: list[Connection]) -> Iterator[Finding]:
    """Yields rooms with more connections than one may have."""
    count = Counter(end for _, ends, _ in connections for end in set(ends))
    for room, number in count.items():
        if number > MAX_CONNECTIONS_OF_ROOM:
            allowed = f"at most {MAX_CONNECTIONS_OF_ROOM} connections of one room; {room} has {number}"
            yield Finding(("DesiredConnections",), [list(ends) for _, ends, _ in connections], allowed)


def version_2_fields(data: object, loc: Location) -> Iterator[Finding]:
    """Yields what only version 2 has, anywhere below raw data that stands at ``loc``."""
    only = 'only in a body with Version: "2"'
    if data == TARGET_ALL and loc[-1:] == ("TargetSet",):
        yield Finding(loc, TARGET_ALL, only)
    for key, value in _children(data):
        if key in ("Doorways", "OriginalName") and value is not None:
            yield Finding((*loc, key), value, only)
        else:
            yield from version_2_fields(value, (*loc, key))


def _children(data: object) -> list[tuple[str | int, object]]:
    if isinstance(data, Spec):
        return [(name, getattr(data, name)) for name in type(data).model_fields]
    if isinstance(data, dict):
        return [(key, value) for key, value in cast("dict[Any, object]", data).items() if isinstance(key, str)]
    return list(enumerate(items(data)))
