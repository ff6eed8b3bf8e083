"""WorldForge template bodies, versions 1 and 2: what a generated world shall look like.

The fields, bounds and defaults are those of the published schemas; what only RoboMaker's prose says (areas, connections
of a room, contradictions) is a rule (docs/reference/robomaker.md, section 6). Rooms that a target set names need not
exist: samples do that.
"""

import json
from collections import Counter
from collections.abc import Iterator
from typing import Annotated, Any, Literal, cast

from pydantic import AfterValidator, Field, JsonValue, ModelWrapValidatorHandler, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from specs.base import Spec, digest
from specs.data.world import RoomType
from specs.field_types import Number, Text
from specs.rules import Finding, Location, Ruled, broken, items, part, repeated
from specs.template.interior import TARGET_ALL, InteriorTemplate, TemplateElementName

_WRAPPER_KEY = "templateBody"
_OWN_KEY, _COMMON_KEYS = "buildings", frozenset({"version", "name"})
_VERSION_2_ROOM = {
    "Type": "Living",
    "Name": "My_Living_Room",
    "OriginalName": "My Living Room",
    "DesiredShape": {"Area": 20.0, "AspectRatio": {"x": 1.0, "y": 1.0}},
}


# The rules look at raw data, which may be wrong in other ways too.
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


def looks_like_body(data: object) -> bool:
    """Returns whether raw data has what only a template body has, in any of its forms, or nothing at all."""
    try:
        body, _ = bare_body(data)
        body, _ = bare_body(body) if isinstance(body, str) else (body, ())
    except PydanticCustomError:
        return False
    if not isinstance(body, dict):
        return False
    keys = {str(key).lower() for key in cast("dict[object, object]", body)}
    return _OWN_KEY in keys or keys <= _COMMON_KEYS


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


AREA_M2 = (10.0, 300.0)


def _area(value: float) -> float:
    if AREA_M2[0] <= value <= AREA_M2[1]:
        return value
    raise broken(f"from {AREA_M2[0]:g} to {AREA_M2[1]:g} square metres")


class AspectRatio(Spec):
    """Proportions x : y, from 1:4 to 4:1.

    Attributes:
        x: One side.
        y: The other.
    """

    x: Annotated[Number, Field(ge=1, le=4)] = 1.0
    y: Annotated[Number, Field(ge=1, le=4)] = 1.0


class FloorplanFootprint(Spec):
    """Outline of the building.

    Attributes:
        DesiredAspectRatio: Wished proportions of the building.
    """

    DesiredAspectRatio: AspectRatio = AspectRatio()


class FloorplanCeiling(Spec):
    """Height of all walls, in metres.

    Attributes:
        Height: In metres.
    """

    Height: Annotated[Number, Field(ge=2.4, le=4.0)] = 3.0


class Rectangle(Spec):
    """A room's wished floor: area in square metres and proportions.

    Attributes:
        Area: In square metres.
        AspectRatio: Wished proportions.
    """

    Area: Annotated[
        Number,
        AfterValidator(_area),
        Field(json_schema_extra={"minimum": AREA_M2[0], "maximum": AREA_M2[1]}),
    ]
    AspectRatio: AspectRatio


_SQUARE = Rectangle(Area=20.0, AspectRatio=AspectRatio())


class FloorplanRoom(Spec):
    """One room; its type decides neighbours, materials and furniture, not its shape.

    Attributes:
        Type: What kind of room it is.
        Name: A name of its own, letters, digits, spaces, underscores and hyphens.
        DesiredShape: Wished area and proportions.
        OriginalName: What it was called before version 2 (version 2).
    """

    Type: RoomType
    Name: TemplateElementName
    DesiredShape: Rectangle = _SQUARE
    OriginalName: Text | None = None


_LIVING_ROOM = FloorplanRoom(Type="Living", Name="My Living Room")


class FloorplanConnection(Spec):
    """A wished way between two rooms: a doorway, or an opening (the wall between them left out).

    Attributes:
        Location: Names of the two rooms.
        ConnectionType: A doorway, or the whole wall left out.
    """

    Location: Annotated[tuple[Text, ...], Field(min_length=2, max_length=2)]
    ConnectionType: Literal["Doorway", "Opening"]


class FloorplanTemplate(Ruled):
    """The floor plan: outline, ceiling, rooms and how they are connected.

    Attributes:
        Footprint: Outline of the building.
        Ceiling: How high the rooms are.
        Rooms: From 1 to 6.
        DesiredConnections: Wished ways between rooms, at most 12.
    """

    Footprint: FloorplanFootprint = FloorplanFootprint()
    Ceiling: FloorplanCeiling = FloorplanCeiling()
    Rooms: Annotated[tuple[FloorplanRoom, ...], Field(min_length=1, max_length=6)] = (_LIVING_ROOM,)
    DesiredConnections: Annotated[tuple[FloorplanConnection, ...], Field(max_length=12)] = ()

    @classmethod
    def findings(cls, data: object) -> Iterator[Finding]:
        """Yields rooms of the same name, and connections that cannot be."""
        rooms = part(data, "Rooms")
        names = [part(room, "Name") for room in (items(rooms) if rooms is not None else (_LIVING_ROOM,))]
        for number, name in enumerate(names):
            if isinstance(name, str) and name in names[:number]:
                yield Finding(("Rooms", number, "Name"), name, "a name of its own; an earlier room has this one")
        connections = list(connections_of(part(data, "DesiredConnections")))
        yield from unknown_rooms(connections, [name for name in names if isinstance(name, str)])
        yield from contradictions(connections)
        yield from crowded_rooms(connections)


class FloorTemplate(Spec):
    """The one floor.

    Attributes:
        Floorplan: Rooms and how they are connected.
        Interior: How they look inside.
    """

    Floorplan: FloorplanTemplate = FloorplanTemplate()
    Interior: InteriorTemplate = InteriorTemplate()


class BuildingTemplate(Spec):
    """The one building.

    Attributes:
        Floors: Exactly one.
    """

    Floors: Annotated[tuple[FloorTemplate, ...], Field(min_length=1, max_length=1)] = (FloorTemplate(),)


class TemplateBody(Ruled):
    """A WorldForge template body.

    Accepted too: the body as JSON text (as CreateWorldTemplate has it), and a document that holds either under
    ``templateBody`` (as RoboMaker's samples are printed).

    Attributes:
        Version: 2 has doors and original names of rooms.
        Buildings: Exactly one.
    """

    Version: Literal["1", "2"] = "1"
    Buildings: Annotated[tuple[BuildingTemplate, ...], Field(min_length=1, max_length=1)] = (BuildingTemplate(),)

    @classmethod
    def findings(cls, data: object) -> Iterator[Finding]:
        """Yields fields of version 2 in a body of version 1; a version that is the number 2 has a fault of its own."""
        if part(data, "Version") not in ("2", 2):
            yield from version_2_fields(data, ())

    @model_validator(mode="wrap")
    @classmethod
    def _unwrap(cls, data: object, handler: ModelWrapValidatorHandler["TemplateBody"]) -> "TemplateBody":
        body, prefix = bare_body(data)
        if not prefix:
            return handler(with_version_2_defaults(body))
        try:
            return cls.model_validate(body)
        except ValidationError as exc:
            raise ValidationError.from_exception_data(cls.__name__, repeated(exc, prefix)) from exc


def template_body(data: JsonValue) -> TemplateBody:
    """Returns the template body in any of the forms that RoboMaker's documents have it in.

    Args:
        data: The body, the body as JSON text, or either under ``templateBody``.

    Raises:
        pydantic.ValidationError: With all faults; ``tasks.documents.parse`` puts them in plain words.
    """
    return TemplateBody.model_validate(data)


def template_digest(body: TemplateBody) -> str:
    """Returns the SHA-256 of the body with all defaults spelled out, lower-case hex."""
    return digest(body)
