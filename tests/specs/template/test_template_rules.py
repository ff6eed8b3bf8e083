from typing import Any

import pytest
from pydantic import ValidationError

from specs.template.body import TemplateBody, template_body, template_digest


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
