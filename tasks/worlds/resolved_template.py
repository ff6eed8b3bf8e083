"""What the generator needs of a template, with all precedence resolved; only this module knows TemplateBody.

A set that targets a room by name beats one that targets its type, which beats one for the whole home; of two at the
same level the first listed wins (docs/reference/robomaker.md, section 6, leaves that open). Doorways follow the same
rule, and one that no set names gets a door that stands fully open.

The three densities of furniture are figures here. Free floor is floor that is not under or in furniture. Homes as
furniture shops show them leave about four fifths of a room free; a robot that gets around in less than two thirds is
the exception. Measured on rooms of 10 to 60 m2 of all seven types, the mean free share is 0.89 for Sparse, 0.79 for
Moderate and 0.70 for Dense.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

from specs.data.world import ROBOT_RADIUS_M, RoomType
from specs.template.body import AspectRatio, FloorplanConnection, FloorplanRoom, TemplateBody
from specs.template.interior import (
    TARGET_ALL,
    Density,
    FurnitureArrangementSet,
    InteriorDoorways,
    InteriorDoorwaySet,
    InteriorMaterialSet,
    InteriorTemplate,
    RoomNameList,
    RoomPairTargetFilter,
    RoomTypeList,
)

Opening = float | Literal["Random"]
"""Percent of a quarter turn, or drawn anew for each world."""
FULLY_OPEN = 100.0
DEFAULT_AREA_M2: float = FloorplanRoom.model_fields["DesiredShape"].default.Area
PassageKind = Literal["Doorway", "Opening"]
AnySet = TypeVar("AnySet", FurnitureArrangementSet, InteriorMaterialSet)
COVERED: dict[Density, float] = {"Sparse": 0.1, "Moderate": 0.2, "Dense": 0.32}
"""Share of a room's floor that furniture shall cover."""
COVERED_BY_TYPE: dict[RoomType, dict[Density, float]] = {
    "Bedroom": {"Sparse": 0.11, "Moderate": 0.23, "Dense": 0.34},
    "Hallway": {"Sparse": 0.1, "Moderate": 0.2, "Dense": 0.34},
    "Closet": {"Sparse": 0.1, "Moderate": 0.2, "Dense": 0.36},
}
"""The same for rooms that are unlike the rest: beds are large, and what lines a wall never fills a room."""
COVERED_SPREAD = 0.01
"""By how much rooms of one type and density may differ from that."""
FREE_FLOOR: dict[Density, tuple[float, float]] = {"Sparse": (0.82, 1.0), "Moderate": (0.73, 0.85), "Dense": (0.5, 0.79)}
"""Least and greatest share of a room's floor that is free when the wish counts as met."""


@dataclass(frozen=True)
class DoorWishes:
    """How far doors stand open.

    Attributes:
        wished: The opening by pair of rooms (indices of rooms, lower first), where a set names the pair.
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


@dataclass(frozen=True)
class RoomWish:
    """One room as the template wants it.

    Attributes:
        aspect: Extent along x over extent along y.
        floorings: Material types to draw the floor from; empty leaves it to the generator.
        walls: Material types to draw the walls from; empty leaves it to the generator.
        furniture: Model types to draw from; None leaves it to the room's type, empty leaves the room empty.
        density: How full of furniture.
        density_wished: Whether the template says so. Rooms that no arrangement targets are moderately full, and so are
            those whose arrangement lists furniture and nothing else.
    """

    name: str
    type: RoomType
    area_m2: float
    aspect: float
    floorings: tuple[str, ...]
    walls: tuple[str, ...]
    furniture: tuple[str, ...] | None
    density: Density
    density_wished: bool = False


@dataclass(frozen=True)
class ConnectionWish:
    """A wished way between two rooms (indices of rooms, lower first); repeated for several doorways."""

    rooms: tuple[int, int]
    kind: PassageKind


@dataclass(frozen=True)
class ResolvedTemplate:
    """A template, reduced to numbers and choices.

    Attributes:
        footprint_aspect: Extent along x over extent along y.
        doors: What hangs in the doorways; None when doorways have no doors (version 1).
        robot_radius_m: Every room shall be reachable with a robot of this radius.
    """

    footprint_aspect: float
    ceiling_height_m: float
    rooms: tuple[RoomWish, ...]
    connections: tuple[ConnectionWish, ...]
    doors: DoorWishes | None = None
    robot_radius_m: float = ROBOT_RADIUS_M


def resolve_template(template: TemplateBody, robot_radius_m: float = ROBOT_RADIUS_M) -> ResolvedTemplate:
    """Returns the generator's view of a template, whose own rules TemplateBody has checked.

    Args:
        template: Any valid template.
        robot_radius_m: Radius of the robot that shall get into every room.
    """
    floor = template.Buildings[0].Floors[0]
    plan, interior = floor.Floorplan, floor.Interior
    return ResolvedTemplate(
        footprint_aspect=_ratio(plan.Footprint.DesiredAspectRatio),
        ceiling_height_m=plan.Ceiling.Height,
        rooms=tuple(_room_wish(room, interior) for room in plan.Rooms),
        connections=_connections(plan.DesiredConnections, [room.Name for room in plan.Rooms]),
        doors=door_wishes(interior.Doorways, plan.Rooms),
        robot_radius_m=robot_radius_m,
    )


def _ratio(aspect: AspectRatio) -> float:
    return aspect.x / aspect.y


def _room_wish(room: FloorplanRoom, interior: InteriorTemplate) -> RoomWish:
    furnishing = governing_set(interior.Furniture.FurnitureArrangements, room)
    sample = None if furnishing is None else furnishing.SampleSet
    return RoomWish(
        name=room.Name,
        type=room.Type,
        area_m2=room.DesiredShape.Area,
        aspect=_ratio(room.DesiredShape.AspectRatio),
        floorings=_materials(interior.Flooring.MaterialSets, room),
        walls=_materials(interior.Walls.MaterialSets, room),
        furniture=None if sample is None else sample.ModelTypes,
        density="Moderate" if furnishing is None else furnishing.DesiredSpatialDensity,
        density_wished=furnishing is not None and (sample is None or furnishing.DesiredSpatialDensity != "Moderate"),
    )


def _materials(sets: Sequence[InteriorMaterialSet], room: FloorplanRoom) -> tuple[str, ...]:
    chosen = governing_set(sets, room)
    return () if chosen is None or chosen.SampleSet is None else chosen.SampleSet.MaterialTypes


def governing_set(sets: Sequence[AnySet], room: FloorplanRoom) -> AnySet | None:
    """Returns the set that governs a room (components page: name before type), or None."""
    return next(_by_rank(sets, room), None)


def _by_rank(sets: Sequence[AnySet], room: FloorplanRoom) -> Iterator[AnySet]:
    targets = [(each, each.TargetSet) for each in sets]
    yield from (each for each, target in targets if isinstance(target, RoomNameList) and room.Name in target.RoomNames)
    yield from (each for each, target in targets if isinstance(target, RoomTypeList) and room.Type in target.RoomTypes)
    yield from (each for each, target in targets if target == TARGET_ALL)


def _connections(wishes: Sequence[FloorplanConnection], names: Sequence[str]) -> tuple[ConnectionWish, ...]:
    pairs = (sorted(names.index(name) for name in wish.Location) for wish in wishes)
    return tuple(
        ConnectionWish((low, high), wish.ConnectionType) for (low, high), wish in zip(pairs, wishes, strict=True)
    )
