"""WorldForge template bodies: the published schemas, and the rules of RoboMaker's prose."""

import json
from typing import Any, cast

import pytest
from pydantic import ValidationError

from specs.base import Spec
from specs.template import body as body_module
from specs.template import interior
from specs.template.body import TemplateBody, template_body, template_digest
from tests.repository import ROOT
from tests.specs.own_words import robomakers_words

DATA = ROOT / "tests" / "data"
V1: dict[str, Any] = json.loads((DATA / "template-v1.schema.json").read_text())
V2: dict[str, Any] = json.loads((DATA / "template-v2.delta.json").read_text())
ADDED_IN_VERSION_2 = {"FloorplanRoom": {"OriginalName"}, "InteriorTemplate": {"Doorways"}}
AREA = {"minimum": 10.0, "maximum": 300.0}
"""Of a room; RoboMaker's prose has these bounds, its schema has not."""
Schema = dict[str, Any]


def _model(name: str) -> type[Spec]:
    return cast("type[Spec]", getattr(body_module, name, None) or getattr(interior, name))


def _plain(value: object) -> object:
    """Removes what schemas may say or leave out at will."""
    if isinstance(value, dict):
        kept = {key: _plain(below) for key, below in cast("Schema", value).items() if below is not None}
        return {key: below for key, below in kept.items() if (key, below) != ("minItems", 0)}
    return [_plain(one) for one in cast("list[object]", value)] if isinstance(value, list) else value


def _field(schema: Schema) -> Schema:
    schema = {key: value for key, value in schema.items() if key not in ("title", "description", "position")}
    options = schema.pop("anyOf", None) or schema.pop("oneOf", None) or schema.pop("allOf", [])
    kept = [one for one in options if one.get("type") != "null" and "const" not in one]
    if len(kept) == 1:
        schema |= kept[0]
    elif kept:
        schema["oneOf"] = sorted(one["$ref"].rpartition("/")[2] for one in kept)
    if "$ref" in schema:
        schema["$ref"] = schema["$ref"].rpartition("/")[2]
    if "enum" in schema:
        schema["enum"] = robomakers_words(schema["enum"])
    if "items" in schema:
        schema["items"] = _field(schema["items"])
    if "pattern" in schema:
        schema["pattern"] = schema["pattern"].replace("(?:", "").replace(")$", "$")
    return cast("Schema", _plain(schema))


def _described(schema: Schema) -> Schema:
    assert schema["additionalProperties"] is False
    fields = {name: _field(field) for name, field in schema["properties"].items()}
    return {"fields": fields, "required": sorted(schema.get("required", []))}


@pytest.mark.parametrize("name", sorted(V1["definitions"]))
def test_a_definition_is_modelled_exactly_as_the_schema_has_it(name: str):
    found = _described(_model(name).model_json_schema())
    for added in ADDED_IN_VERSION_2.get(name, ()):
        del found["fields"][added]
    if name == "Rectangle":
        area = found["fields"]["Area"]
        assert {key: area.pop(key) for key in AREA} == AREA

    assert found == _described(V1["definitions"][name])


def test_the_body_is_modelled_as_the_schema_has_it_with_both_versions():
    expected = _described(V1)
    expected["fields"]["Version"]["enum"] = ["1", "2"]

    assert _described(TemplateBody.model_json_schema()) == expected


def test_a_body_of_version_2_has_the_default_room_of_version_2():
    body = template_body({"Version": "2", "Buildings": [{"Floors": [{"Floorplan": {}, "Interior": {}}]}]})

    (room,) = body.Buildings[0].Floors[0].Floorplan.Rooms
    assert room.model_dump(mode="json") == V2["defaultRoom"]
    assert body == template_body({"Version": "2"})


def test_doorways_have_the_bounds_and_defaults_of_version_2():
    sets = interior.InteriorDoorways.model_json_schema()["properties"]["DoorwaySets"]
    door = interior.DoorOpenPosition.model_json_schema()["properties"]["Percent"]
    state = interior.InteriorDoor()

    assert sets["maxItems"] == V2["InteriorDoorways"]["DoorwaySets"]["maxItems"]
    assert [
        {key: one[key] for key in ("type", "minimum", "maximum", "const") if key in one} for one in door["anyOf"]
    ] == [
        {"type": "number", "minimum": 0, "maximum": 100},
        {"type": "string", "const": "Random"},
    ]
    assert state.InitialState.OpenPosition.model_dump() == V2["DoorInitialState"]["OpenPosition"]["default"]


def body(rooms: list[str], *connections: tuple[str, str, str], version: str = "1", **more: object) -> dict[str, Any]:
    plan = {
        "Rooms": [{"Type": "Living", "Name": name} for name in rooms],
        "DesiredConnections": [{"Location": [a, b], "ConnectionType": kind} for a, b, kind in connections],
    }
    return {"Version": version, "Buildings": [{"Floors": [{"Floorplan": plan, **more}]}]}


def faults(document: dict[str, Any]) -> list[tuple[str, str]]:
    """Where a body is wrong, below the floor plan where that is, and what is allowed."""
    with pytest.raises(ValidationError) as caught:
        template_body(document)
    errors = [error for error in caught.value.errors() if error["type"] != "too_short"]
    return [(".".join(map(str, error["loc"][4:])), error["msg"]) for error in errors]


def test_two_rooms_of_one_name_are_refused():
    assert faults(body(["Hall", "Den", "Hall"])) == [
        ("Floorplan.Rooms.2.Name", "a name of its own; an earlier room has this one")
    ]


def test_a_connection_to_a_room_that_is_not_there_is_refused():
    assert faults(body(["Hall", "Den"], ("Hall", "Attic", "Doorway"))) == [
        ("Floorplan.DesiredConnections.0.Location.1", "a room of Rooms: Hall, Den")
    ]


def test_connections_may_name_the_default_room():
    plan = {"DesiredConnections": [{"Location": ["My Living Room", "Den"], "ConnectionType": "Doorway"}]}

    assert faults({"Buildings": [{"Floors": [{"Floorplan": plan}]}]}) == [
        ("Floorplan.DesiredConnections.0.Location.1", "a room of Rooms: My Living Room")
    ]


def test_a_room_is_not_connected_with_itself():
    assert faults(body(["Hall"], ("Hall", "Hall", "Doorway"))) == [
        ("Floorplan.DesiredConnections.0.Location", "two different rooms")
    ]


def test_an_opening_and_a_doorway_between_the_same_rooms_contradict():
    assert faults(body(["Hall", "Den"], ("Hall", "Den", "Opening"), ("Den", "Hall", "Doorway"))) == [
        (
            "Floorplan.DesiredConnections.1.ConnectionType",
            "either one Opening or Doorways between Den and Hall; DesiredConnections[0] is Opening",
        )
    ]


def test_two_openings_between_the_same_rooms_are_refused():
    assert faults(body(["Hall", "Den"], ("Hall", "Den", "Opening"), ("Hall", "Den", "Opening"))) == [
        (
            "Floorplan.DesiredConnections.1.ConnectionType",
            "one Opening between Hall and Den; DesiredConnections[0] is Opening",
        )
    ]


def test_several_doorways_between_the_same_rooms_are_allowed():
    template_body(body(["Hall", "Den"], ("Hall", "Den", "Doorway"), ("Den", "Hall", "Doorway")))


def test_a_room_has_at_most_four_connections():
    others = ["A", "B", "C", "D", "E"]
    four = [("Hall", name, "Doorway") for name in others[:4]]

    template_body(body(["Hall", *others], *four))
    assert faults(body(["Hall", *others], *four, ("E", "Hall", "Doorway"))) == [
        ("Floorplan.DesiredConnections", "at most 4 connections of one room; Hall has 5")
    ]


@pytest.mark.parametrize("area", [9.99, 300.01])
def test_a_room_of_another_size_than_10_to_300_square_metres_is_refused(area: float):
    document = body(["Hall"])
    document["Buildings"][0]["Floors"][0]["Floorplan"]["Rooms"][0]["DesiredShape"] = {"Area": area, "AspectRatio": {}}

    assert faults(document) == [("Floorplan.Rooms.0.DesiredShape.Area", "from 10 to 300 square metres")]


@pytest.mark.parametrize(
    ("place", "more"),
    [
        ("Interior.Doorways", {"Interior": {"Doorways": {"DoorwaySets": []}}}),
        (
            "Interior.Walls.MaterialSets.0.TargetSet",
            {"Interior": {"Walls": {"MaterialSets": [{"Name": "All", "TargetSet": "Target.All"}]}}},
        ),
    ],
)
def test_what_only_version_2_has_is_refused_in_version_1(place: str, more: dict[str, Any]):
    template_body(body(["Hall"], version="2", **more))

    assert faults(body(["Hall"], **more)) == [(place, 'only in a body with Version: "2"')]


@pytest.mark.parametrize(("version", "told"), [(2, [""]), ([], ["", "Interior.Doorways"])])
def test_a_version_that_is_the_number_2_is_the_only_fault(version: object, told: list[str]):
    interior = {"Doorways": {"DoorwaySets": []}}
    body = {"Version": version, "Buildings": [{"Floors": [{"Floorplan": {}, "Interior": interior}]}]}
    assert [place for place, _ in faults(body)] == told  # the version lies above the floor


def test_faults_of_fields_and_broken_rules_are_told_together():
    document = body(["Hall", "Den"], ("Hall", "Den", "Opening"), ("Hall", "Den", "Doorway"))
    document["Buildings"][0]["Floors"][0]["Floorplan"]["Rooms"][0]["Type"] = "Sauna"
    document["Buildings"][0]["Floors"][0]["Interior"] = {"Doorways": {"DoorwaySets": []}, "Ceilings": {}}

    assert [place for place, _ in faults(document)] == [
        "Floorplan.Rooms.0.Type",
        "Floorplan.DesiredConnections.1.ConnectionType",
        "Interior.Ceilings",
        "Interior.Doorways",
    ]


def test_rooms_that_a_target_set_names_need_not_exist():
    target = {"Name": "Attic", "TargetSet": {"RoomNames": ["My Attic"]}}

    template_body(body(["Hall"], Interior={"Flooring": {"MaterialSets": [target]}}))


def test_spelling_a_default_out_does_not_change_the_digest():
    assert template_digest(template_body({})) == template_digest(
        template_body({"Version": "1", "Buildings": [{"Floors": [{"Interior": {}}]}]})
    )
    assert template_digest(template_body({})) != template_digest(template_body({"Version": "2"}))


def test_text_that_is_no_json_is_refused_with_what_it_may_be():
    with pytest.raises(ValidationError, match="an object, or the same as JSON text"):
        template_body("{")


def test_a_body_that_was_validated_is_taken_as_it_is():
    made = TemplateBody(Version="2")

    assert TemplateBody.model_validate(made) is made
