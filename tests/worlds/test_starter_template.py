"""The template to begin with is valid for any rooms, complete, and gives worlds whose doors let a robot through."""

import json
from itertools import pairwise
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, JsonValue

from specs.data.world import ROBOT_RADIUS_M, RoomType
from specs.template.body import TemplateBody, template_body
from tasks.documents.source_text import decode_source_text
from tasks.worlds.generate import generate_world
from tasks.worlds.starter_template import STARTER_ROOMS, Version, commented_yaml, starter_json, starter_template
from tests.worlds.templates import ROOM_TYPES

VERSIONS: tuple[Version, ...] = get_args(Version)
HALL_AND_BEDROOMS: tuple[RoomType, ...] = ("Hallway", "Bedroom", "Bedroom", "Bedroom", "Bedroom", "Bedroom")
HOMES = (("Closet",), ("Bathroom", "Bathroom"), STARTER_ROOMS, HALL_AND_BEDROOMS, ROOM_TYPES[:6])
ROOMS = st.lists(st.sampled_from(ROOM_TYPES), min_size=1, max_size=6)


@given(ROOMS, st.sampled_from(VERSIONS))
def test_any_rooms_give_a_valid_template_that_reads_back_as_it_was_meant(rooms: list[RoomType], version: Version):
    body = starter_template(rooms, version)
    assert [room.Type for room in template_body(body).Buildings[0].Floors[0].Floorplan.Rooms] == rooms
    assert decode_source_text(commented_yaml(body).encode(), "template.yaml") == body
    assert json.loads(starter_json(body)) == body


@pytest.mark.parametrize("rooms", HOMES)
def test_a_robot_gets_into_every_room_with_the_doors_as_they_stand_and_every_wish_is_met(rooms: tuple[RoomType, ...]):
    body = template_body(starter_template(rooms, "2"))
    certificate = generate_world(body, seed=4, generation="g", floorplan_index=1, interior_index=1).certificate
    assert certificate.unmet == ()
    assert certificate.doors_as_set_robot_radius_m >= ROBOT_RADIUS_M


def test_it_has_every_key_that_a_template_may_have_but_the_older_name_of_a_room():
    written = set(_keys(starter_template(STARTER_ROOMS, "2")))
    assert _fields(TemplateBody) - written == {"OriginalName"}


def test_every_part_with_bounds_has_a_comment():
    lines = commented_yaml(starter_template(STARTER_ROOMS, "2")).splitlines()
    told = {line.split(":")[0].strip(" -") for before, line in pairwise(lines) if "#" in before}
    assert {"Version", "Rooms", "Area", "AspectRatio", "Ceiling", "Doorways", "DesiredSpatialDensity"} <= told


def _keys(data: JsonValue) -> list[str]:
    if isinstance(data, list):
        return [key for item in data for key in _keys(item)]
    return [key for name, below in data.items() for key in (name, *_keys(below))] if isinstance(data, dict) else []


def _fields(model: type[BaseModel]) -> set[str]:
    found = set(model.model_fields)
    for field in model.model_fields.values():
        for below in _models(field.annotation):
            found |= _fields(below)
    return found


def _models(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]
