"""Hypothesis strategies for documents: RoboMaker's shapes, template bodies, pipelines."""

import json
import re
from collections import Counter
from functools import cache
from itertools import combinations
from typing import Any, get_args

from hypothesis import strategies as st

from specs.data.world import RoomType
from specs.template.interior import TARGET_ALL, Density, ModelType
from tests.repository import ROOT

Documents = st.SearchStrategy[dict[str, Any]]
_SHAPES: dict[str, Any] = json.loads((ROOT / "tests" / "data" / "contract.json").read_text())["shapes"]
_LINE = st.characters(exclude_categories=["Cs"], exclude_characters="\n")

names = st.from_regex(r"[a-zA-Z0-9][a-zA-Z0-9_\-]{0,20}", fullmatch=True)
seeds = st.integers(0, 2**32 - 1)


def optional(required: dict[str, st.SearchStrategy[Any]], **others: st.SearchStrategy[Any]) -> Documents:
    """Objects with all the required keys and some of the others."""
    return st.fixed_dictionaries(required, optional=others)


@cache
def shape(name: str) -> st.SearchStrategy[Any]:
    """JSON data of a shape of the contract that breaks no rule of docs/reference/robomaker.md either."""
    if name in _RULED:
        return _RULED[name]
    stated = _SHAPES[name]
    if stated["type"] == "structure":
        fields = {field: _field(name, field, below["shape"]) for field, below in stated.get("fields", {}).items()}
        required = {field: fields.pop(field) for field in stated.get("required") or ()}
        return optional(required, **fields)
    if stated["type"] == "list":
        low, high = stated.get("min", 0), stated.get("max", 2)
        return st.lists(shape(stated["item"]), min_size=low, max_size=min(high, low + 2))
    if stated["type"] == "map":
        return st.dictionaries(shape(stated["key"]), shape(stated["value"]), max_size=2)
    return _scalar(stated)


def _scalar(stated: dict[str, Any]) -> st.SearchStrategy[Any]:
    match stated["type"]:
        case "string":
            return _text(stated)
        case "boolean":
            return st.booleans()
        case "float" | "timestamp":
            return st.floats(stated.get("min", 0.0), stated.get("max", 4e9))
        case _:
            return st.integers(stated.get("min", 0), stated.get("max", 2**40))


def _field(owner: str, field: str, name: str) -> st.SearchStrategy[Any]:
    if field == "templateBody" and owner in {"CreateWorldTemplateRequest", "UpdateWorldTemplateRequest"}:
        return template_bodies().map(json.dumps)
    if (owner, field) == ("OutputLocation", "s3Prefix"):
        return _PREFIXES
    if field == "tags" and owner in ("CreateDeploymentJobRequest", "CreateRobotRequest"):
        return st.dictionaries(st.from_regex("[A-Za-z0-9_]{1,9}", fullmatch=True), shape("TagValue"), max_size=2)
    return shape(name)


def _text(stated: dict[str, Any]) -> st.SearchStrategy[str]:
    low, high = stated.get("min", 0), stated.get("max", 40)
    if "enum" in stated:
        return st.sampled_from(stated["enum"])
    if stated.get("pattern", ".*") == ".*":
        return st.text(_LINE, min_size=low, max_size=min(high, 40))
    return st.from_regex(re.compile(stated["pattern"], re.ASCII), fullmatch=True).filter(
        lambda text: low <= len(text) <= high
    )


# Of S3Key, what stays inside a bucket.
_PART = st.from_regex(r"[a-zA-Z0-9_ =\-][a-zA-Z0-9_ .=\-]{0,20}", fullmatch=True)
_PREFIXES = st.lists(_PART, min_size=1, max_size=4).map("/".join)

_RULED: dict[str, st.SearchStrategy[Any]] = {
    "JobDuration": st.integers(1, 691_200),
    "BatchTimeoutInSeconds": st.integers(1, 1_209_600),
    "MaxConcurrency": st.integers(1, 1000),
    "DeploymentTimeout": st.integers(60, 604_800),
    "TagKey": _text(_SHAPES["TagKey"]).filter(lambda key: not key.lower().startswith("aws:")),
    "EnvironmentVariableKey": _text(_SHAPES["EnvironmentVariableKey"]).filter(lambda key: not key.startswith("AWS")),
}

_RATIO = optional({}, x=st.floats(1, 4), y=st.floats(1, 4))
_ROOM_NAME = st.from_regex(r"[a-zA-Z0-9_\- ]{1,12}", fullmatch=True)
_ROOM_TYPE = st.sampled_from(get_args(RoomType))
_BY_NAME = st.fixed_dictionaries({"RoomNames": st.lists(st.text(max_size=9), min_size=1, max_size=6)})
_BY_TYPE = st.fixed_dictionaries({"RoomTypes": st.lists(_ROOM_TYPE, min_size=1, max_size=7)})


def template_bodies() -> Documents:
    """Template bodies of both versions, with and without what has a default."""
    return st.sampled_from(["1", "2"]).flatmap(_body)


def _body(version: str) -> Documents:
    floor = optional({}, Floorplan=_floorplans(version), Interior=_interiors(version))
    building = optional({}, Floors=st.lists(floor, min_size=1, max_size=1))
    buildings = st.lists(building, min_size=1, max_size=1)
    return optional({"Version": st.just(version)} if version == "2" else {}, Buildings=buildings)


@st.composite
def _floorplans(draw: st.DrawFn, version: str) -> dict[str, Any]:
    more = {"OriginalName": st.text(max_size=9)} if version == "2" else {}
    shapes = st.fixed_dictionaries({"Area": st.floats(10, 300), "AspectRatio": _RATIO})
    unique = draw(st.lists(_ROOM_NAME, min_size=1, max_size=6, unique=True))
    rooms = [
        draw(optional({"Type": _ROOM_TYPE, "Name": st.just(name)}, DesiredShape=shapes, **more)) for name in unique
    ]
    plan: dict[str, Any] = {"Rooms": rooms, "DesiredConnections": _connections(draw, unique)}
    plan |= draw(
        optional(
            {},
            Footprint=optional({}, DesiredAspectRatio=_RATIO),
            Ceiling=optional({}, Height=st.floats(2.4, 4.0)),
        )
    )
    left_out = draw(st.sampled_from([(), ("DesiredConnections",), ("DesiredConnections", "Rooms")]))
    return {key: value for key, value in plan.items() if key not in left_out}


def _connections(draw: st.DrawFn, rooms: list[str]) -> list[dict[str, Any]]:
    pairs = draw(st.lists(st.sampled_from(list(combinations(rooms, 2))), max_size=12, unique=True)) if rooms[1:] else []
    ends: Counter[str] = Counter()
    found: list[dict[str, Any]] = []
    for pair in pairs:
        if max(ends[pair[0]], ends[pair[1]]) < 4 and len(found) < 12:
            ends.update(pair)
            kind = draw(st.sampled_from(["Doorway", "Opening"]))
            found.append({"Location": draw(st.permutations(pair)), "ConnectionType": kind})
    return found


def _interiors(version: str) -> Documents:
    target = st.one_of(_BY_NAME, _BY_TYPE, *([st.just(TARGET_ALL)] if version == "2" else []))
    materials = st.fixed_dictionaries({"MaterialTypes": st.lists(st.text(max_size=9), min_size=1, max_size=2)})
    models = st.fixed_dictionaries({"ModelTypes": st.lists(st.sampled_from(get_args(ModelType)), max_size=3)})
    named = {"Name": _ROOM_NAME, "TargetSet": target}
    material_sets = st.lists(optional(named, SampleSet=materials), max_size=6)
    density = st.sampled_from(get_args(Density))
    arrangements = st.lists(optional(named, SampleSet=models, DesiredSpatialDensity=density), max_size=6)
    doors = {"Doorways": optional({}, DoorwaySets=st.lists(_doorway_sets(), max_size=3))} if version == "2" else {}
    return optional(
        {},
        Flooring=optional({}, MaterialSets=material_sets),
        Walls=optional({}, MaterialSets=material_sets),
        Furniture=optional({}, FurnitureArrangements=arrangements),
        **doors,
    )


def _doorway_sets() -> Documents:
    rooms = st.one_of(_BY_NAME, _BY_TYPE)
    target = st.one_of(st.just(TARGET_ALL), st.fixed_dictionaries({"From": rooms, "To": rooms}))
    position = optional({}, Percent=st.one_of(st.floats(0, 100), st.just("Random")))
    door = optional({}, InitialState=optional({}, OpenPosition=position))
    return optional({"Name": st.text(max_size=9), "TargetSet": target}, Door=door)


_REFERENCE = st.one_of(names, shape("Arn"))
_WORLD = st.one_of(st.builds("{}/{}".format, names, names), shape("Arn"))
_WORLDS = st.one_of(st.just("all"), st.lists(_WORLD, min_size=1, max_size=3, unique=True))
_PLACE = optional({"s3Bucket": shape("S3Bucket")}, s3Prefix=_PREFIXES)
_TOKEN = shape("ClientRequestToken")
_TAGS = shape("TagMap")


@st.composite
def pipelines(draw: st.DrawFn) -> dict[str, Any]:
    """Pipelines with every combination of sections that can be."""
    document: dict[str, Any] = {"name": draw(names)}
    if draw(st.booleans()):
        document["worldGeneration"] = draw(_generations())
        document |= draw(optional({}, worldExport=_exports(), simulationBatch=_batches()))
    else:
        document["deployment"] = draw(_deployments())
    if "simulationBatch" in document:
        document |= draw(optional({}, gate=_gates(), deployment=_deployments()))
    return document


def _generations() -> Documents:
    count = st.sampled_from([{}, {"floorplanCount": 50}, {"floorplanCount": 7, "interiorCountPerFloorplan": 7}])
    template = st.one_of(_REFERENCE, template_bodies(), template_bodies().map(json.dumps))
    return optional(
        {"template": template, "worldCount": count},
        seed=seeds,
        tags=_TAGS,
        worldTags=_TAGS,
        clientRequestToken=_TOKEN,
    )


def _exports() -> Documents:
    formats = st.lists(st.sampled_from(["mjcf", "svg"]), min_size=1, unique=True)
    return optional(
        {"outputLocation": _PLACE},
        worlds=_WORLDS,
        formats=formats,
        iamRole=shape("IamRole"),
        tags=_TAGS,
        clientRequestToken=_TOKEN,
    )


def _batches() -> Documents:
    values = st.lists(shape("EnvironmentVariableValue"), min_size=1, max_size=3, unique=True)
    matrix = optional(
        {},
        worlds=_WORLDS,
        seeds=st.one_of(st.integers(1, 10_000), st.lists(seeds, min_size=1, max_size=3, unique=True)),
        environmentVariables=st.dictionaries(shape("EnvironmentVariableKey"), values, max_size=2),
    )
    return optional(
        {"createSimulationJobRequests": st.lists(shape("SimulationJobRequest"), min_size=1, max_size=2)},
        batchPolicy=shape("BatchPolicy"),
        outputLocation=_PLACE,
        matrix=matrix,
        engine=st.sampled_from(["auto", "planar", "mjx", "mujoco"]),
        tags=_TAGS,
        clientRequestToken=_TOKEN,
    )


def _gates() -> Documents:
    rate = optional({"atLeast": st.floats(0, 1, exclude_max=True)}, confidence=st.floats(0.5, 0.9999))
    bar = st.floats(0.001, 0.999)
    quantile = st.fixed_dictionaries({"column": st.just("spl"), "quantile": bar, "atMost": st.floats(-9, 9)})
    return optional(
        {"successRate": rate},
        noWorseThan=optional(
            {"applicationVersion": shape("DeploymentVersion"), "margin": bar}, confidence=st.floats(0.5, 0.9999)
        ),
        collisionRate=st.fixed_dictionaries({"atMost": bar}),
        maxOutcomeFlipRate=st.fixed_dictionaries({"atMost": bar}),
        quantiles=st.lists(quantile, min_size=1, max_size=1),
        stopEarly=st.booleans(),
    )


def _deployments() -> Documents:
    local = optional({"name": names}, localAgents=st.integers(0, 20))
    application = optional(
        {"application": _REFERENCE, "launchConfig": shape("DeploymentLaunchConfig")},
        applicationVersion=shape("DeploymentVersion"),
    )
    return optional(
        {
            "fleet": st.one_of(_REFERENCE, local),
            "deploymentApplicationConfigs": st.lists(application, min_size=1, max_size=1),
        },
        deploymentConfig=shape("DeploymentConfig"),
        rollOut=optional({}, canaryRobots=st.integers(0, 1000), leastExecutedRobots=st.integers(0, 1000)),
        clientRequestToken=_TOKEN,
    )
