"""Templates for the tests of world generation: samples, plain ones, and random valid ones."""

import json
from typing import get_args

from hypothesis import strategies as st
from pydantic import JsonValue

from specs.data.world import RoomType
from specs.template.body import TemplateBody
from specs.template.interior import Density, ModelType
from tests.repository import ROOT

SAMPLES = sorted((ROOT / "tests/worlds/data").glob("*.body.json"))
ROOM_TYPES: tuple[RoomType, ...] = get_args(RoomType)
MODEL_TYPES: tuple[str, ...] = get_args(ModelType)
DENSITIES: tuple[str, ...] = get_args(Density)
FLOORINGS = ("Carpet", "Concrete", "Floorboards", "Linoleum", "Parquetry", "Tiles")
WALLS = ("Brick", "Concrete", "Stone", "Tiles", "Wood panels", "Wall paint", "Wallpaper")


def sample(name: str) -> TemplateBody:
    """Returns one of RoboMaker's samples."""
    path = ROOT / "tests/worlds/data" / f"{name}.body.json"
    return TemplateBody.model_validate(json.loads(path.read_text()))


def room(
    name: str, kind: RoomType = "Living", area_m2: float = 20.0, aspect: tuple[float, float] = (1.0, 1.0)
) -> dict[str, JsonValue]:
    """Returns a room as a template has it."""
    shape: dict[str, JsonValue] = {"Area": area_m2, "AspectRatio": {"x": aspect[0], "y": aspect[1]}}
    return {"Type": kind, "Name": name, "DesiredShape": shape}


def connection(first: str, second: str, kind: str = "Doorway") -> dict[str, JsonValue]:
    """Returns a wished connection as a template has it."""
    return {"Location": [first, second], "ConnectionType": kind}


def furniture(target: JsonValue, models: list[str] | None = None, density: str = "Moderate") -> dict[str, JsonValue]:
    """Returns a furniture arrangement as a template has it; without models it has no sample set."""
    arrangement: dict[str, JsonValue] = {"Name": "set", "TargetSet": target, "DesiredSpatialDensity": density}
    return arrangement if models is None else {**arrangement, "SampleSet": {"ModelTypes": list(models)}}


def materials(target: JsonValue, *names: str) -> dict[str, JsonValue]:
    """Returns a material set as a template has it."""
    return {"Name": "set", "TargetSet": target, "SampleSet": {"MaterialTypes": list(names)}}


def template(
    *rooms: dict[str, JsonValue],
    connections: tuple[dict[str, JsonValue], ...] = (),
    arrangements: tuple[dict[str, JsonValue], ...] = (),
    flooring: tuple[dict[str, JsonValue], ...] = (),
    walls: tuple[dict[str, JsonValue], ...] = (),
    footprint: tuple[float, float] = (1.0, 1.0),
    ceiling_m: float = 3.0,
    version: str = "1",
    doorways: tuple[dict[str, JsonValue], ...] = (),
) -> TemplateBody:
    """Returns a template of these rooms and wishes."""
    plan: dict[str, JsonValue] = {
        "Footprint": {"DesiredAspectRatio": {"x": footprint[0], "y": footprint[1]}},
        "Ceiling": {"Height": ceiling_m},
        "Rooms": list(rooms),
        "DesiredConnections": list(connections),
    }
    interior: dict[str, JsonValue] = {
        "Flooring": {"MaterialSets": list(flooring)},
        "Walls": {"MaterialSets": list(walls)},
        "Furniture": {"FurnitureArrangements": list(arrangements)},
    }
    if doorways:
        interior["Doorways"] = {"DoorwaySets": list(doorways)}
    buildings: JsonValue = [{"Floors": [{"Floorplan": plan, "Interior": interior}]}]
    return TemplateBody.model_validate({"Version": version, "Buildings": buildings})


def doorway(target: JsonValue, percent: JsonValue = 100.0) -> dict[str, JsonValue]:
    """Returns a doorway set (version 2) as a template has it."""
    return {"Name": "doors", "TargetSet": target, "Door": {"InitialState": {"OpenPosition": {"Percent": percent}}}}


_sides = st.one_of(st.just(1.0), st.floats(1.0, 4.0).map(lambda side: round(side, 2)))
_aspects = st.tuples(_sides, _sides)


@st.composite
def templates(draw: st.DrawFn) -> TemplateBody:
    """Returns a random valid template of version 1 or 2."""
    count = draw(st.integers(1, 6))
    names = [f"Room {number}" for number in range(count)]
    rooms = [
        room(name, draw(st.sampled_from(ROOM_TYPES)), round(draw(st.floats(10.0, 45.0)), 1), draw(_aspects))
        for name in names
    ]
    version = draw(st.sampled_from(("1", "2")))
    homes = version == "2"
    return template(
        *rooms,
        connections=draw(_connections(names)),
        arrangements=tuple(draw(st.lists(_arrangements(names), max_size=4))),
        flooring=tuple(draw(st.lists(_material_sets(names, FLOORINGS, whole_home=homes), max_size=3))),
        walls=tuple(draw(st.lists(_material_sets(names, WALLS, whole_home=homes), max_size=3))),
        footprint=draw(_aspects),
        ceiling_m=round(draw(st.floats(2.4, 4.0)), 3),
        version=version,
        doorways=tuple(draw(st.lists(_doorways(names), max_size=3))) if version == "2" else (),
    )


@st.composite
def _connections(draw: st.DrawFn, names: list[str]) -> tuple[dict[str, JsonValue], ...]:
    pairs = [(first, second) for n, first in enumerate(names) for second in names[n + 1 :]]
    chosen = draw(st.lists(st.sampled_from(pairs), unique=True, max_size=5)) if pairs else []
    kinds = [draw(st.sampled_from(("Doorway", "Opening"))) for _ in chosen]
    kept: list[dict[str, JsonValue]] = []
    for number, (first, second) in enumerate(chosen):
        used = [name for pair in chosen[:number] for name in pair]
        if used.count(first) < 4 and used.count(second) < 4:
            kept.append(connection(first, second, kinds[number]))
    return tuple(kept)


@st.composite
def _arrangements(draw: st.DrawFn, names: list[str]) -> dict[str, JsonValue]:
    by_name = st.sampled_from(names).map(lambda name: _target("RoomNames", name))
    by_type = st.sampled_from(ROOM_TYPES).map(lambda kind: _target("RoomTypes", kind))
    models = draw(st.none() | st.lists(st.sampled_from(MODEL_TYPES), max_size=8))
    return furniture(draw(st.one_of(by_name, by_type)), models, draw(st.sampled_from(DENSITIES)))


@st.composite
def _material_sets(
    draw: st.DrawFn, names: list[str], known: tuple[str, ...], *, whole_home: bool
) -> dict[str, JsonValue]:
    by_name = st.sampled_from(names).map(lambda name: _target("RoomNames", name))
    by_type = st.sampled_from(ROOM_TYPES).map(lambda kind: _target("RoomTypes", kind))
    target = draw(st.one_of(by_name, by_type, *([st.just("Target.All")] if whole_home else [])))
    return materials(target, *draw(st.lists(st.sampled_from((*known, "Lava")), min_size=1, max_size=2)))


@st.composite
def _doorways(draw: st.DrawFn, names: list[str]) -> dict[str, JsonValue]:
    ends = st.one_of(
        st.sampled_from(names).map(lambda name: _target("RoomNames", name)),
        st.sampled_from(ROOM_TYPES).map(lambda kind: _target("RoomTypes", kind)),
    )
    pair: dict[str, JsonValue] = {"From": draw(ends), "To": draw(ends)}
    percent = st.one_of(st.just("Random"), st.floats(0.0, 100.0).map(lambda value: round(value, 1)))
    return doorway(draw(st.sampled_from(("Target.All", pair))), draw(percent))


def _target(key: str, name: str) -> dict[str, JsonValue]:
    return {key: [name]}
