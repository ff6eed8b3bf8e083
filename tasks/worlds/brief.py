"""What the generator needs of a template, with all precedence resolved; only this module knows TemplateBody.

A set that targets a room by name beats one that targets its type, which beats one for the whole home; of two at the
same level the first listed wins (semantics 6 leaves that open).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

from specs.template import AspectRatio, FloorplanConnection, FloorplanRoom, TemplateBody
from specs.template_interior import (
    TARGET_ALL,
    Density,
    FurnitureArrangementSet,
    InteriorMaterialSet,
    InteriorTemplate,
    RoomNameList,
    RoomTypeList,
)
from specs.world import ROBOT_RADIUS_M, RoomType
from tasks.worlds.door_wishes import DoorWishes, door_wishes

PassageKind = Literal["Doorway", "Opening"]
AnySet = TypeVar("AnySet", FurnitureArrangementSet, InteriorMaterialSet)


@dataclass(frozen=True)
class RoomWish:
    """One room as the template wants it.

    Attributes:
        aspect: Extent along x over extent along y.
        floorings: Material types to draw the floor from; empty leaves it to the generator.
        walls: Material types to draw the walls from; empty leaves it to the generator.
        furniture: Model types to draw from; None leaves it to the room's type, empty leaves the room empty.
        density: How full of furniture.
        density_wished: Whether the template says so; rooms that no arrangement targets are moderately full.
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
    """A wished way between two rooms (indices into the brief's rooms, lower first); repeated for several doorways."""

    rooms: tuple[int, int]
    kind: PassageKind


@dataclass(frozen=True)
class Brief:
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


def brief_of(template: TemplateBody, robot_radius_m: float = ROBOT_RADIUS_M) -> Brief:
    """Returns the generator's view of a template, whose own rules TemplateBody has checked.

    Args:
        template: Any valid template.
        robot_radius_m: Radius of the robot that shall get into every room.
    """
    floor = template.Buildings[0].Floors[0]
    plan, interior = floor.Floorplan, floor.Interior
    return Brief(
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
    furnishing = _governing(interior.Furniture.FurnitureArrangements, room)
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
        density_wished=furnishing is not None,
    )


def _materials(sets: Sequence[InteriorMaterialSet], room: FloorplanRoom) -> tuple[str, ...]:
    chosen = _governing(sets, room)
    return () if chosen is None or chosen.SampleSet is None else chosen.SampleSet.MaterialTypes


def _governing(sets: Sequence[AnySet], room: FloorplanRoom) -> AnySet | None:
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
