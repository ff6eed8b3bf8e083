"""WorldForge template bodies, versions 1 and 2: what a generated world shall look like.

The fields, bounds and defaults are those of the published schemas; what only RoboMaker's prose says (areas, connections
of a room, contradictions) is a rule (docs/reference/robomaker.md, section 6). Rooms that a target set names need not
exist: samples do that.
"""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, JsonValue, ModelWrapValidatorHandler, ValidationError, model_validator

from specs.base import Spec
from specs.data.world import RoomType
from specs.digest import digest
from specs.field_types import Number, Text
from specs.rules import Finding, Ruled, broken, items, part, repeated
from specs.template.interior import InteriorTemplate, TemplateElementName
from specs.template.raw_body import (
    bare_body,
    connections_of,
    contradictions,
    crowded_rooms,
    unknown_rooms,
    version_2_fields,
    with_version_2_defaults,
)

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
