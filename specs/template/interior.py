"""The interior half of a WorldForge template body: materials, furniture, and (version 2) doors."""

from typing import Annotated, Literal

from pydantic import Field

from specs.base import Spec
from specs.data.world import RoomType
from specs.field_types import Number, Text, text
from specs.rules import by_shape, member

TARGET_ALL = "Target.All"
NAMES_PATTERN = r"[a-zA-Z0-9_\- ]*"

TemplateElementName = Annotated[str, text(1, 255, NAMES_PATTERN)]
Density = Literal["Sparse", "Moderate", "Dense"]
ModelType = Literal[
    "Baths",
    "BarCabinets",
    "Beds",
    "Bookcases",
    "CoffeeTables",
    "ConsoleTables",
    "CornerCabinets",
    "DeskChairs",
    "Desks",
    "DiningChairs",
    "DiningTables",
    "DishWashers",
    "Dressers",
    "EndAndSideTables",
    "FloorLamps",
    "Fridges",
    "LivingRoomChairs",
    "KitchenIslandsAndCarts",
    "MediaStorage",
    "Nightstands",
    "Ottomans",
    "Ovens",
    "ServingCarts",
    "Showers",
    "SideboardsAndBuffets",
    "Sofas",
    "Storage",
    "StorageBenches",
    "Toilets",
    "VanityCounters",
    "WashingMachinesAndDryers",
]


class RoomNameList(Spec):
    """Rooms by name.

    Attributes:
        RoomNames: From 1 to 6.
    """

    RoomNames: Annotated[tuple[Text, ...], Field(min_length=1, max_length=6)]


class RoomTypeList(Spec):
    """Rooms by type; not every type listed need appear in the floor plan.

    Attributes:
        RoomTypes: From 1 to 7.
    """

    RoomTypes: Annotated[tuple[RoomType, ...], Field(min_length=1, max_length=7)]


_ROOMS = "rooms as {RoomNames: [...]} or {RoomTypes: [...]}"
RoomTargetFilter = Annotated[
    Annotated[RoomNameList, member("RoomNameList")] | Annotated[RoomTypeList, member("RoomTypeList")],
    by_shape(_ROOMS, RoomNameList="RoomNames", RoomTypeList="RoomTypes"),
]
RoomTarget = Annotated[
    Annotated[RoomNameList, member("RoomNameList")]
    | Annotated[RoomTypeList, member("RoomTypeList")]
    | Annotated[Literal["Target.All"], member("text")],
    by_shape(
        f"{_ROOMS}, or {TARGET_ALL}", RoomNameList="RoomNames", RoomTypeList="RoomTypes", text=frozenset({TARGET_ALL})
    ),
]


class MaterialSetByMaterialType(Spec):
    """Materials to choose from at random; known ones are matched without regard to case and spaces.

    Attributes:
        MaterialTypes: At least one.
    """

    MaterialTypes: Annotated[tuple[Text, ...], Field(min_length=1)]


class InteriorMaterialSet(Spec):
    """What the floors or walls of some rooms are made of; without a sample set, what suits the room's type.

    Attributes:
        Name: What the set is called.
        TargetSet: Which rooms it is for.
        SampleSet: What is chosen from.
    """

    Name: TemplateElementName
    TargetSet: RoomTarget
    SampleSet: MaterialSetByMaterialType | None = None


MaterialSetList = Annotated[tuple[InteriorMaterialSet, ...], Field(max_length=6)]


class InteriorFlooring(Spec):
    """Floor materials.

    Attributes:
        MaterialSets: At most 6.
    """

    MaterialSets: MaterialSetList = ()


class InteriorWalls(Spec):
    """Wall materials.

    Attributes:
        MaterialSets: At most 6.
    """

    MaterialSets: MaterialSetList = ()


class ModelTypeList(Spec):
    """Kinds of furniture to choose from at random; an empty list leaves the room unfurnished.

    Attributes:
        ModelTypes: What may stand there; nothing, if empty.
    """

    ModelTypes: tuple[ModelType, ...]


class FurnitureArrangementSet(Spec):
    """What stands in some rooms and how densely; without a sample set, what suits the room's type.

    Attributes:
        Name: What the set is called.
        TargetSet: Which rooms it is for.
        SampleSet: What is chosen from.
        DesiredSpatialDensity: How full the rooms are.
    """

    Name: TemplateElementName
    TargetSet: RoomTarget
    SampleSet: ModelTypeList | None = None
    DesiredSpatialDensity: Density = "Moderate"


class InteriorFurnishings(Spec):
    """Furniture.

    Attributes:
        FurnitureArrangements: At most 6.
    """

    FurnitureArrangements: Annotated[tuple[FurnitureArrangementSet, ...], Field(max_length=6)] = ()


class RoomPairTargetFilter(Spec):
    """Doorways between two groups of rooms: every pair of one from each (version 2).

    Attributes:
        From: Rooms on one side.
        To: Rooms on the other.
    """

    From: RoomTargetFilter
    To: RoomTargetFilter


class DoorOpenPosition(Spec):
    """How far a door stands open, in percent, or anew for each world (version 2).

    Attributes:
        Percent: 0 is closed, 100 fully open; Random differs from world to world.
    """

    Percent: Annotated[
        Annotated[Number, Field(ge=0, le=100), member("number")] | Annotated[Literal["Random"], member("text")],
        by_shape("a number from 0 to 100, or Random", number=(int, float), text=frozenset({"Random"})),
    ] = 100.0


class DoorInitialState(Spec):
    """How a door stands when the world is made (version 2).

    Attributes:
        OpenPosition: How far it stands open.
    """

    OpenPosition: DoorOpenPosition = DoorOpenPosition()


class InteriorDoor(Spec):
    """A hinged door (version 2).

    Attributes:
        InitialState: How it stands when the world is made.
    """

    InitialState: DoorInitialState = DoorInitialState()


DoorwayTarget = Annotated[
    Annotated[RoomPairTargetFilter, member("RoomPairTargetFilter")] | Annotated[Literal["Target.All"], member("text")],
    by_shape(
        f"pairs of rooms as {{From: ..., To: ...}}, or {TARGET_ALL}",
        RoomPairTargetFilter=dict,
        text=frozenset({TARGET_ALL}),
    ),
]


class InteriorDoorwaySet(Spec):
    """What hangs in some doorways; a doorway that no set names gets a random door, fully open (version 2).

    Attributes:
        Name: What the set is called.
        TargetSet: Which doorways it is for.
        Door: How the door stands; fully open, if left out.
    """

    Name: Text
    TargetSet: DoorwayTarget
    Door: InteriorDoor | None = None


class InteriorDoorways(Spec):
    """Doors in doorways (version 2).

    Attributes:
        DoorwaySets: At most 13.
    """

    DoorwaySets: Annotated[tuple[InteriorDoorwaySet, ...], Field(max_length=13)] = ()


class InteriorTemplate(Spec):
    """How the rooms look inside.

    Attributes:
        Flooring: What floors are made of.
        Walls: What walls are made of.
        Furniture: What stands in the rooms.
        Doorways: What hangs in the doorways (version 2).
    """

    Flooring: InteriorFlooring = InteriorFlooring()
    Walls: InteriorWalls = InteriorWalls()
    Furniture: InteriorFurnishings = InteriorFurnishings()
    Doorways: InteriorDoorways | None = None
