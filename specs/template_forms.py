"""The forms that RoboMaker's documents have a template body in, made into one."""

import json
from typing import cast

from specs.rules import Location, broken, items, part

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
            raise broken("a template body: an object, or the same as JSON text") from exc
    for key in (_WRAPPER_KEY, "name"):
        inner = part(data, key)
        if isinstance(inner, dict) or (key == _WRAPPER_KEY and isinstance(inner, str)):
            return inner, (key,)
    return data, ()


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
