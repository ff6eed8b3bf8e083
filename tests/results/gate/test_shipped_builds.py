"""Each build and each variable that ships was driven, or the document names it."""

from collections.abc import Mapping, Sequence

import pytest

from specs.pipeline.simulation_section import Deployment, UntestedBuild
from specs.robomaker.bundle import ARCHITECTURES, Build, Version
from tasks.results.gate.evidence import ApplicationEvidence, Evidence, shipment_changes
from tasks.results.gate.shipped_builds import (
    Shipment,
    build_faults,
    differing_names,
    shipment_lines,
    shipment_of,
    unjudged_lines,
    variable_faults,
    version_changes,
)
from tests.results.gate.test_evidence import evidence

X86, ARM, FORGED = "a" * 64, "b" * 64, "f" * 64  # the evidence is about the first
NAMED = {"ARM64": {"testedAs": "X86_64", "digest": ARM}}


def version(*digests: str) -> Version:
    builds = tuple(
        Build(architecture=architecture, digest=digest, size_bytes=1)
        for architecture, digest in zip(ARCHITECTURES, digests, strict=False)
    )
    shared = {"kind": "robot-application", "name": "courier", "number": 3, "size_bytes": 1, "created_at_s": 0.0}
    return Version.model_validate({**shared, "digest": X86, "builds": builds})


def section(**more: object) -> Deployment:
    launch = {"packageName": "courier", "launchFile": "run.sh", "environmentVariables": {"MAX_SPEED": "0.3"}}
    use = {"application": "courier", "launchConfig": launch}
    return Deployment.model_validate({"fleet": "couriers", "deploymentApplicationConfigs": [use], **more})


def faults(of: Version, named: dict[str, dict[str, str]], *driven: str) -> list[tuple[str, str]]:
    read = section(untestedBuilds=named).untestedBuilds or {}
    return [(fault.path, fault.value) for fault in build_faults(of, read, driven)]


def judged(ships: Shipment | None, *digests: str) -> Evidence:
    robots = tuple(ApplicationEvidence(name="courier", version="3", digest=digest) for digest in digests)
    return evidence().model_copy(update={"robots": robots, "ships": ships})


def test_one_bundle_for_all_architectures_needs_no_word():
    assert faults(version(), {}, X86) == []


def test_builds_of_the_same_bytes_need_no_word():
    assert faults(version(X86, X86), {}, X86) == []


def test_builds_that_were_all_driven_need_no_word():
    assert faults(version(X86, ARM), {}, X86, ARM) == []


def test_a_build_that_nobody_drove_is_a_fault_that_says_how_to_drive_or_to_name_it():
    (fault,) = build_faults(version(X86, ARM), {}, [X86])
    assert fault.path == "deployment.untestedBuilds"
    assert fault.value == f"the build of courier version 3 for ARM64, {ARM}, which no episode drives"
    assert "robotApplications have architecture: ARM64" in fault.allowed
    assert "{ARM64: {testedAs: X86_64, digest: ...}}" in fault.allowed


def test_a_build_that_the_document_names_ships():
    assert faults(version(X86, ARM), NAMED, X86) == []


def test_a_build_that_was_put_in_the_place_of_the_named_one_does_not_ship():
    assert faults(version(X86, FORGED), NAMED, X86) == [("deployment.untestedBuilds.ARM64.digest", ARM)]


def test_a_build_that_nobody_drove_stands_for_no_other():
    named = {**NAMED, "ARMHF": {"testedAs": "ARM64", "digest": FORGED}}
    assert faults(version(X86, ARM, FORGED), named, X86) == [("deployment.untestedBuilds.ARMHF.testedAs", "ARM64")]


@pytest.mark.parametrize("of", [version(X86, ARM), version(X86, X86)])
def test_naming_a_build_that_was_driven_is_a_fault(of: Version):
    digest = of.digests["ARM64"]
    named = {"ARM64": {"testedAs": "X86_64", "digest": digest}}
    assert faults(of, named, X86, ARM) == [("deployment.untestedBuilds.ARM64", digest)]


@pytest.mark.parametrize(
    ("of", "allowed"),
    [
        (version(), "an architecture none: courier version 3 has one bundle for all"),
        (version(X86), "an architecture of courier version 3: X86_64"),
    ],
)
def test_naming_a_build_that_the_version_lacks_is_a_fault(of: Version, allowed: str):
    (fault,) = build_faults(of, {"ARM64": UntestedBuild(testedAs="X86_64", digest=ARM)}, [X86])
    assert (fault.path, fault.value) == ("deployment.untestedBuilds", "ARM64")
    assert fault.allowed == allowed


def test_a_shipment_tells_each_build_each_variable_and_what_of_them_was_not_driven():
    untested = {"LOG": "read by run.sh alone"}
    ships = shipment_of(section(untestedBuilds=NAMED, untestedVariables=untested), version(X86, ARM))
    assert ships.digests() == {"X86_64": X86, "ARM64": ARM}
    assert list(shipment_lines(ships)) == [
        "courier version 3 for X86_64, aaaaaaaaaaaa: simulated",
        "courier version 3 for ARM64, bbbbbbbbbbbb: NOT SIMULATED; the document says that the build for X86_64 stands "
        "for it",
        "variables as simulated: MAX_SPEED=0.3",
        "variable LOG: NOT AS SIMULATED; the document says why: read by run.sh alone",
    ]


def test_without_a_gate_each_build_is_told_with_whether_it_is_simulated():
    assert list(unjudged_lines(shipment_of(section(), version(X86, ARM)), [X86])) == [
        "courier version 3 for X86_64, aaaaaaaaaaaa: simulated",
        "courier version 3 for ARM64, bbbbbbbbbbbb: not simulated, and no gate asks",
    ]


def test_what_the_evidence_names_ships():
    ships = shipment_of(section(untestedBuilds=NAMED), version(X86, ARM))
    assert list(shipment_changes(judged(ships, X86), ships)) == []


def test_what_the_evidence_does_not_name_does_not_ship():
    ships = shipment_of(section(), version(X86, X86))
    (line,) = shipment_changes(judged(None, X86), ships)
    assert line.endswith("the evidence of simb-1 names nothing")


def test_a_build_that_the_gate_did_not_judge_does_not_ship_whatever_the_evidence_names():
    ships = shipment_of(section(), version(X86, FORGED))
    (line,) = shipment_changes(judged(ships, X86), ships)
    assert line == f"the build for ARM64, {FORGED}, is not one that the gate judged"


def test_a_value_that_no_episode_had_does_not_ship_whatever_the_evidence_names():
    ships = shipment_of(section(), version()).model_copy(update={"variables": {"MAX_SPEED": "9"}})
    (line,) = shipment_changes(judged(ships, X86), ships)
    assert line == "variable MAX_SPEED is to be '9' on robots, which no episode of simb-1 had"


@pytest.mark.parametrize(
    ("now", "line"),
    [
        (version(X86, ARM), f"courier version 3 for ARM64 is {ARM} now; when the run began it was not there"),
        (version(), f"courier version 3 for X86_64 is gone now; when the run began it was {X86}"),
    ],
)
def test_builds_that_have_changed_since_the_run_began_are_named(now: Version, line: str):
    assert list(version_changes(shipment_of(section(), version(X86)), now)) == [line]
    assert list(version_changes(shipment_of(section(), now), now)) == []


HALF = {"SPEED": ("0.5",)}
PATH = "deployment.deploymentApplicationConfigs[0].launchConfig.environmentVariables"
Builds = Sequence[Sequence[Mapping[str, Sequence[str]]]]


def variable_faults_of(given: dict[str, str], driven: Builds, **named: str) -> list[tuple[str, str]]:
    found = variable_faults(given, driven, named)
    return [(fault.path.removeprefix(f"{PATH}."), fault.value) for fault in found]


def test_a_value_that_episodes_had_ships():
    assert variable_faults_of({"SPEED": "0.5"}, [[HALF]]) == []
    assert variable_faults_of({"SPEED": "0.6"}, [[{"SPEED": ("0.4", "0.6")}]]) == []


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
    assert variable_faults_of({"SPEED": "9"}, [[HALF]], SPEED="kilometres an hour on robots") == []
    assert variable_faults_of({}, [[HALF]], SPEED="the robot's own default is half a metre a second") == []


@pytest.mark.parametrize("name", ["SPEED", "NOBODYS"])
def test_naming_what_does_not_differ_is_a_fault(name: str):
    assert variable_faults_of({"SPEED": "0.5"}, [[HALF]], **{name: "why"}) == [
        (f"deployment.untestedVariables.{name}", "'why'")
    ]


def test_values_that_no_episode_had_together_are_a_difference():
    driven = [{"SPEED": ("0.5",), "GAIN": ("1",)}, {"SPEED": ("1",), "GAIN": ("2",)}]
    assert variable_faults_of({"SPEED": "1", "GAIN": "2"}, [driven]) == []
    assert len(variable_faults_of({"SPEED": "1", "GAIN": "1"}, [driven])) == 1


def test_each_build_that_ships_had_the_value():
    assert variable_faults_of({"SPEED": "0.5"}, [[HALF], [{"SPEED": ("0.4",)}]]) == [("SPEED", "'0.5'")]
    assert variable_faults_of({"SPEED": "0.5"}, [[HALF], [{"SPEED": ("0.4",)}]], SPEED="why") == []


def test_differences_are_found_without_a_gate_too():
    assert differing_names({"SPEED": "9", "SAME": "1"}, [[{**HALF, "SAME": ("1",), "GONE": ("2",)}]]) == [
        "GONE",
        "SPEED",
    ]


def test_of_a_thousand_values_a_few_are_told():
    (fault,) = variable_faults({}, [[{"SPEED": tuple(map(str, range(1000)))}]], {})
    assert "'7', ...;" in fault.allowed
    assert "'8'" not in fault.allowed
