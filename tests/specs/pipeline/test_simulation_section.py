"""Robot and scenario share the variables of a request."""

from typing import Any

import pytest
from pydantic import ValidationError

from specs.base import canonical_document
from specs.data.boxes import Box
from specs.data.people import MOST_PEOPLE
from specs.pipeline.section_requests import undriven_faults
from specs.pipeline.simulation_section import SimulationBatch


def section(robot: dict[str, str], scenario: dict[str, str], **matrix: object) -> SimulationBatch:
    """Returns a section whose robot and scenario have variables."""

    def use(variables: dict[str, str]) -> dict[str, Any]:
        return {"application": "mine", "launchConfig": {"environmentVariables": variables}}

    request = {
        "maxJobDurationInSeconds": 60,
        "robotApplications": [use(robot)],
        "simulationApplications": [use(scenario)],
    }
    return SimulationBatch.model_validate({"createSimulationJobRequests": [request], "matrix": matrix})


def test_two_values_of_one_variable_are_refused_and_both_fields_are_named():
    with pytest.raises(ValidationError) as caught:
        section({"RANGE": "2"}, {"RANGE": "4"})
    (error,) = caught.value.errors()
    use = "launchConfig.environmentVariables.RANGE"
    assert ".".join(map(str, error["loc"])) == f"createSimulationJobRequests.0.simulationApplications.0.{use}"
    assert error["input"] == "4"
    assert error["msg"] == (
        f"'2' as in createSimulationJobRequests[0].robotApplications[0].{use}, or another name: robot and scenario see "
        "the same variables"
    )


def test_an_equal_value_or_other_names_are_fine():
    assert section({"RANGE": "2", "SPEED": "1"}, {"RANGE": "2", "GOALS": "1"})


def test_a_swept_variable_may_have_two_values_that_nobody_uses():
    assert section({"RANGE": "2"}, {"RANGE": "4"}, environmentVariables={"RANGE": ["1", "3"]})


@pytest.mark.parametrize(
    ("launch", "lacking"),
    [
        ({"command": ["x"]}, []),
        ({"packageName": "a", "launchFile": "a.launch"}, []),
        ({"packageName": "a", "launchFile": "go", "command": ["x"]}, ["robotApplications"]),
        ({"launchFile": "go", "command": ["x"]}, ["robotApplications", "packageName"]),
    ],
    ids=["command", "launch file", "module", "no package"],
)
def test_a_command_beside_a_launch_file_has_no_effect(launch: dict[str, object], lacking: list[str]):
    alone = {"simulationApplications": [{"launchConfig": launch}]}
    found = undriven_faults({"createSimulationJobRequests": [alone]})
    assert [fault.path.rpartition(".")[2] for fault in found] == lacking


def peopled(**fields: object) -> SimulationBatch:
    """Returns a section with two people."""
    request = {
        "maxJobDurationInSeconds": 60,
        "robotApplications": [{"application": "mine", "launchConfig": {}}],
        "simulationApplications": [{"application": "mine", "launchConfig": {}}],
    }
    return SimulationBatch.model_validate({"createSimulationJobRequests": [request], "people": 2, **fields})


@pytest.mark.parametrize("fields", [{}, {"engine": "mujoco"}, {"engine": "mjx"}, {"audit": {"lanes": 8}}])
def test_people_walk_on_every_engine_and_are_audited(fields: dict[str, Any]):
    assert peopled(**fields).people == 2


def test_as_many_people_as_there_are_places_for_walk_beside_several_robots():
    assert peopled(people=MOST_PEOPLE, robots=3).people == MOST_PEOPLE
    for people in (MOST_PEOPLE + 1, {"count": MOST_PEOPLE + 1}, 0):
        with pytest.raises(ValidationError, match="people"):
            peopled(people=people)


def test_a_document_without_people_says_nothing_of_them():
    assert "people" not in canonical_document(section({}, {}))


def driven_by(robots: object, **fields: object) -> SimulationBatch:
    """Returns a section whose worlds are shared by so many robots."""
    request = {
        "maxJobDurationInSeconds": 60,
        "robotApplications": [{"application": "mine", "launchConfig": {"packageName": "mine", "launchFile": "go"}}],
        "simulationApplications": [
            {"application": "mine", "launchConfig": {"packageName": "mine", "launchFile": "go"}}
        ],
    }
    return SimulationBatch.model_validate({"createSimulationJobRequests": [request], "robots": robots, **fields})


NODES = {
    "maxJobDurationInSeconds": 60,
    "robotApplications": [{"application": "a", "launchConfig": {"packageName": "a", "launchFile": "a.launch"}}],
    "simulationApplications": [{"application": "b", "launchConfig": {"packageName": "b", "launchFile": "go"}}],
}
ONLY_ALONE: list[tuple[dict[str, Any], str]] = [
    ({"engine": "mujoco"}, "engine"),
    ({"engine": "mjx"}, "engine"),
    ({"boxes": [{"size_m": [0.4, 0.4, 0.6]}]}, "boxes"),
    ({"audit": {"lanes": 8}}, "audit.lanes"),
    ({"recordings": {"picturesHz": 1.0}}, "recordings.picturesHz"),
    ({"operation": "CreateSimulationJob"}, "robots"),
    ({"createSimulationJobRequests": [NODES]}, "createSimulationJobRequests.0.robotApplications.0.launchConfig"),
]


@pytest.mark.parametrize(("fields", "path"), ONLY_ALONE)
def test_what_only_a_robot_alone_has_is_refused_for_several(fields: dict[str, Any], path: str):
    with pytest.raises(ValidationError) as refused:
        driven_by(3, **fields)
    assert path in str(refused.value)
    assert driven_by(1, **fields).robots == 1


@pytest.mark.parametrize("robots", [0, 21, 2.5, "two"])
def test_robots_are_counted_from_1_to_20(robots: object):
    with pytest.raises(ValidationError):
        driven_by(robots)


def test_a_document_without_robots_says_nothing_of_them():
    assert "robots" not in canonical_document(section({}, {}))
    assert driven_by(20, engine="planar", audit={"lanes": 0}).robots == 20


def test_a_section_of_several_robots_is_the_same_with_its_defaults_spelled_out():
    asked = driven_by(3)
    assert SimulationBatch.model_validate(asked.model_dump(mode="json")) == asked


BOX: dict[str, Any] = {"size_m": [0.4, 0.4, 0.6]}


def boxed(**fields: object) -> SimulationBatch:
    """Returns a section with a box."""
    request = {
        "maxJobDurationInSeconds": 60,
        "robotApplications": [{"application": "mine", "launchConfig": {}}],
        "simulationApplications": [{"application": "mine", "launchConfig": {}}],
    }
    return SimulationBatch.model_validate({"createSimulationJobRequests": [request], "boxes": [BOX], **fields})


@pytest.mark.parametrize("fields", [{}, {"engine": "mujoco"}, {"engine": "mjx"}, {"audit": {"lanes": 8}}])
def test_boxes_stand_on_every_engine_and_are_audited(fields: dict[str, Any]):
    assert boxed(**fields).boxes == (Box(size_m=(0.4, 0.4, 0.6)),)


def test_a_document_without_boxes_says_nothing_of_them():
    assert "boxes" not in canonical_document(section({}, {}))


@pytest.mark.parametrize(
    ("fields", "path"),
    [
        ({"people": 2}, ("people",)),
        ({"robots": 2}, ("boxes",)),
        ({"boxes": [{**BOX, "appears_s": 5, "leaves_s": 5}]}, ("boxes", 0, "leaves_s")),
        ({"boxes": [BOX, {**BOX, "size_m": [0.4, 0.4, 0.01]}]}, ("boxes", 1, "size_m", 2)),
        ({"boxes": []}, ("boxes",)),
        ({"boxes": [BOX] * 5}, ("boxes",)),
    ],
)
def test_boxes_that_cannot_be_are_refused_at_their_field(fields: dict[str, Any], path: tuple[str | int, ...]):
    with pytest.raises(ValidationError) as caught:
        boxed(**fields)
    assert [error["loc"] for error in caught.value.errors()] == [path]
