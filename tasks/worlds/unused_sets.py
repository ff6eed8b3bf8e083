"""What in a template has no effect: names that no room has, sets that no room takes, materials that there are not."""

import difflib
from collections.abc import Iterator, Mapping, Sequence

from specs.template.body import FloorplanRoom, TemplateBody
from specs.template.interior import (
    InteriorDoorwaySet,
    InteriorMaterialSet,
    RoomNameList,
    RoomPairTargetFilter,
    RoomTypeList,
)
from tasks.worlds.materials import FLOORINGS, WALLS, SurfaceMaterial, known_name
from tasks.worlds.resolved_template import AnySet, governing_set

_CLOSE = 0.7


def unused_sets(template: TemplateBody) -> list[str]:
    """Returns what has no effect, a line each: where it stands, and why.

    RoboMaker's documents may name rooms that are not there, so none of it is a fault.
    """
    floor = template.Buildings[0].Floors[0]
    rooms, interior = floor.Floorplan.Rooms, floor.Interior
    floors, walls = interior.Flooring.MaterialSets, interior.Walls.MaterialSets
    doors = interior.Doorways.DoorwaySets if interior.Doorways else ()
    return [
        *_idle("Flooring.MaterialSets", floors, rooms),
        *_unknown_materials("Flooring.MaterialSets", floors, FLOORINGS),
        *_idle("Walls.MaterialSets", walls, rooms),
        *_unknown_materials("Walls.MaterialSets", walls, WALLS),
        *_idle("Furniture.FurnitureArrangements", interior.Furniture.FurnitureArrangements, rooms),
        *(line for number, each in enumerate(doors) for line in _door_names(number, each, rooms)),
    ]


def _idle(place: str, sets: Sequence[AnySet], rooms: Sequence[FloorplanRoom]) -> Iterator[str]:
    """Yields the names that no room has, and the sets that are for rooms which other sets take."""
    taken = [governing_set(sets, room) for room in rooms]
    for number, each in enumerate(sets):
        where = f"Interior.{place}[{number}].TargetSet"
        unknown = list(_unknown_names(each.TargetSet, rooms))
        yield from (f"{where}: {line}" for line in unknown)
        if not unknown and not any(governing is each for governing in taken):
            yield f"{where}: {_why_idle(each.TargetSet, rooms)}"


def _why_idle(target: object, rooms: Sequence[FloorplanRoom]) -> str:
    types = target.RoomTypes if isinstance(target, RoomTypeList) else ()
    if types and not any(room.Type in types for room in rooms):
        return f"no room is of type {' or '.join(types)}"
    return "sets that name its rooms, or that stand before it, take all of them"


def _unknown_names(target: object, rooms: Sequence[FloorplanRoom]) -> Iterator[str]:
    names = [room.Name for room in rooms]
    for name in target.RoomNames if isinstance(target, RoomNameList) else ():
        if name not in names:
            close = difflib.get_close_matches(name, names, n=1, cutoff=_CLOSE)
            meant = f'; did you mean "{close[0]}"?' if close else f"; there are {', '.join(names)}"
            yield f'no room is called "{name}"{meant}'


def _door_names(number: int, doorways: InteriorDoorwaySet, rooms: Sequence[FloorplanRoom]) -> Iterator[str]:
    target = doorways.TargetSet
    if isinstance(target, RoomPairTargetFilter):
        for side, end in (("From", target.From), ("To", target.To)):
            where = f"Interior.Doorways.DoorwaySets[{number}].TargetSet.{side}"
            yield from (f"{where}: {line}" for line in _unknown_names(end, rooms))


def _unknown_materials(
    place: str, sets: Sequence[InteriorMaterialSet], known: Mapping[str, SurfaceMaterial]
) -> Iterator[str]:
    for number, each in enumerate(sets):
        for name in each.SampleSet.MaterialTypes if each.SampleSet else ():
            if known_name(name, known) is None:
                where = f"Interior.{place}[{number}].SampleSet"
                yield f'{where}: no material is called "{name}"; there are {", ".join(known)}'
