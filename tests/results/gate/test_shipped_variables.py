"""Robots get the variables that episodes had, with values that episodes had, or the document says why not."""

from collections.abc import Mapping, Sequence

import pytest

from tasks.results.gate.shipped_builds import differing_names, variable_faults

HALF = {"SPEED": ("0.5",)}
PATH = "deployment.deploymentApplicationConfigs[0].launchConfig.environmentVariables"
Builds = Sequence[Sequence[Mapping[str, Sequence[str]]]]


def faults(given: dict[str, str], driven: Builds, **named: str) -> list[tuple[str, str]]:
    found = variable_faults(given, driven, named)
    return [(fault.path.removeprefix(f"{PATH}."), fault.value) for fault in found]


def test_a_value_that_episodes_had_ships():
    assert faults({"SPEED": "0.5"}, [[HALF]]) == []
    assert faults({"SPEED": "0.6"}, [[{"SPEED": ("0.4", "0.6")}]]) == []


@pytest.mark.parametrize(
    ("given", "driven", "value", "allowed"),
    [
        ({"SPEED": "9"}, HALF, "'9'", "a value that simulationBatch drives: '0.5'; or"),
        ({}, HALF, "not set", "a value that simulationBatch drives: '0.5'; or"),
        ({"SPEED": "9"}, {}, "'9'", "not set: simulationBatch does not set it; or"),
    ],
)
def test_a_difference_is_a_fault_that_names_field_value_and_what_is_allowed(
    given: dict[str, str], driven: dict[str, tuple[str]], value: str, allowed: str
):
    (fault,) = variable_faults(given, [[driven]], {})
    assert (fault.path, fault.value) == (f"{PATH}.SPEED", value)
    assert fault.allowed == f"{allowed} deployment.untestedVariables.SPEED, with the reason"


def test_a_difference_that_the_document_names_ships():
    assert faults({"SPEED": "9"}, [[HALF]], SPEED="kilometres an hour on robots") == []
    assert faults({}, [[HALF]], SPEED="the robot's own default is half a metre a second") == []


@pytest.mark.parametrize("name", ["SPEED", "NOBODYS"])
def test_naming_what_does_not_differ_is_a_fault(name: str):
    assert faults({"SPEED": "0.5"}, [[HALF]], **{name: "why"}) == [(f"deployment.untestedVariables.{name}", "'why'")]


def test_values_that_no_episode_had_together_are_a_difference():
    driven = [{"SPEED": ("0.5",), "GAIN": ("1",)}, {"SPEED": ("1",), "GAIN": ("2",)}]
    assert faults({"SPEED": "1", "GAIN": "2"}, [driven]) == []
    assert len(faults({"SPEED": "1", "GAIN": "1"}, [driven])) == 1


def test_each_build_that_ships_had_the_value():
    assert faults({"SPEED": "0.5"}, [[HALF], [{"SPEED": ("0.4",)}]]) == [("SPEED", "'0.5'")]
    assert faults({"SPEED": "0.5"}, [[HALF], [{"SPEED": ("0.4",)}]], SPEED="why") == []


def test_differences_are_found_without_a_gate_too():
    assert differing_names({"SPEED": "9", "SAME": "1"}, [[{**HALF, "SAME": ("1",), "GONE": ("2",)}]]) == [
        "GONE",
        "SPEED",
    ]


def test_of_a_thousand_values_a_few_are_told():
    (fault,) = variable_faults({}, [[{"SPEED": tuple(map(str, range(1000)))}]], {})
    assert "'7', ...;" in fault.allowed
    assert "'8'" not in fault.allowed
