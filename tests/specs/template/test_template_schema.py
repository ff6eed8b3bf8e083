"""The template models against the published schema, definition by definition."""

import json
from typing import Any, cast

import pytest

from specs.base import Spec
from specs.template import body as body_module
from specs.template import interior
from specs.template.body import TemplateBody, template_body
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
