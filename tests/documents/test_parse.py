"""A document that is wrong is refused with all its faults at once, in words that say what to write."""

import json
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import JsonValue

from specs.base import Spec
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from specs.pipeline.world_sections import WorldGeneration
from specs.robomaker.deployment import CreateDeploymentJobRequest
from specs.robomaker.simulation import BatchDescribeSimulationJobRequest
from specs.robomaker.world_jobs import CreateWorldTemplateRequest
from specs.template.body import TemplateBody
from tasks.documents.parse import parse
from tests.documents.beginners_templates import BEGINNERS, Body
from tests.factories.strategies import pipelines
from tests.repository import ROOT

GENERATION = {"template": "two-rooms", "worldCount": {}}


def faults(data: dict[str, Any] | list[Any], model: type[Spec] = PipelineSpec) -> dict[str, tuple[str, str]]:
    """What is wrong, by place: what stands there, what may."""
    with pytest.raises(DocumentError) as caught:
        parse(model, data, "a.yaml")
    found = {fault.path: (fault.value, fault.allowed) for fault in caught.value.faults}
    assert len(found) == len(caught.value.faults)
    return found


def pipeline(**sections: object) -> dict[str, object]:
    return {"name": "nightly", "worldGeneration": GENERATION, **sections}


@given(pipelines())
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_a_good_document_is_parsed(document: dict[str, Any]):
    assert parse(PipelineSpec, document) == PipelineSpec.model_validate(document)


def test_an_unknown_key_is_told_with_the_known_one_that_is_meant():
    assert faults(pipeline(worldgeneration={})) == {
        "worldgeneration": (
            "unknown key",
            'did you mean "worldGeneration"? known keys are name, applications, worlds, worldGeneration, worldExport, '
            "simulationBatch, search, gate, deployment",
        )
    }


def test_a_key_in_another_number_is_meant_before_one_of_another_section():
    generation = {"worldGeneration": {**GENERATION, "seeds": 3}}
    assert faults(pipeline(**generation))["worldGeneration.seeds"][1].startswith(
        'did you mean "seed"? or it belongs in simulationBatch.matrix, '
    )
    fleet = {"fleet": {"name": "couriers", "robots": 3}, "deploymentApplicationConfigs": []}
    assert faults(pipeline(deployment=fleet))["deployment.fleet.robots"][1].endswith(
        "known keys here are name, localAgents"
    )


def test_an_unknown_key_that_a_rule_speaks_of_is_told_by_the_rule():
    scan = {"name": "dock", "source": "scan.ply", "at": 0.05}
    ((place, (_, allowed)),) = faults({"name": "nightly", "worlds": [scan]}).items()
    assert place == "worlds[0].at"
    assert "or make a map of ROS (.yaml and .pgm) of the cut" in allowed


def test_the_value_of_an_unknown_key_is_not_repeated():
    assert "hunter2" not in str(faults(pipeline(awsSecretAccessKey="hunter2")))


def test_an_unknown_key_in_a_member_of_a_union_is_told_with_that_members_keys():
    deployment = {"fleet": {"name": "couriers", "agents": 5}, "deploymentApplicationConfigs": []}

    assert faults(pipeline(deployment=deployment)) == {
        "deployment.fleet.agents": (
            "unknown key",
            'did you mean "localAgents"? known keys are name, localAgents',
        ),
        "deployment.deploymentApplicationConfigs": ("[]", "at least 1 item"),
    }


def test_a_needed_key_that_is_misspelt_is_one_fault():
    found = faults(pipeline(worldGeneration={"tempalte": "two-rooms", "worldCount": {}}))
    assert [*found] == ["worldGeneration.tempalte"]
    found = faults(pipeline(worldGeneration={"zzz": "two-rooms", "worldCount": {}}))
    assert {*found} == {"worldGeneration.zzz", "worldGeneration.template"}  # which it is not like


def test_a_whole_number_with_its_unit_is_told_without_it():
    counts = {"60s": "a whole number; write 60, without its unit", "1.5 s": "a whole number", "many": "a whole number"}
    for text, allowed in counts.items():
        section = {**GENERATION, "worldCount": {"floorplanCount": text}}
        assert faults(pipeline(worldGeneration=section)) == {
            "worldGeneration.worldCount.floorplanCount": (json.dumps(text), allowed)
        }


JOB = {"maxJobDurationInSeconds": 60, "robotApplications": [], "simulationApplications": []}


@pytest.mark.parametrize(
    ("section", "place", "advice"),
    [
        ({"people": {"count": 2, "unaware": "25 %"}}, "people.unaware", "a number; write 0.25 for 25 %"),
        ({"people": {"count": 2, "speed_ms": "3.6 km/h"}}, "people.speed_ms", "a number; write 1 for 3.6 km/h"),
        ({"people": {"count": 2, "speed_ms": "1 ms"}}, "people.speed_ms", "a number; write 1, without its unit"),
        (
            {"createSimulationJobRequests": [{**JOB, "maxJobDurationInSeconds": "2 min"}]},
            "createSimulationJobRequests[0].maxJobDurationInSeconds",
            "a whole number; write 120 for 2 min",
        ),
        (
            {"createSimulationJobRequests": [{**JOB, "maxJobDurationInSeconds": "100 ms"}]},
            "createSimulationJobRequests[0].maxJobDurationInSeconds",
            "a whole number",
        ),
        (
            {"matrix": {"physics": {"robot.controlDelay_s": ["100ms"]}}},
            "matrix.physics.robot.controlDelay_s[0]",
            "a number; write 0.1 for 100 ms",
        ),
    ],
)
def test_a_number_in_another_unit_is_told_in_the_one_that_belongs_there(
    section: dict[str, JsonValue], place: str, advice: str
):
    batch = {"createSimulationJobRequests": [JOB], **section}
    assert faults(pipeline(simulationBatch=batch))[f"simulationBatch.{place}"][1] == advice


def test_a_number_alone_where_a_list_of_texts_belongs_is_told_as_text():
    matrix = {"environmentVariables": {"SPEED": 0.3}, "physics": {"robot.mass": 1.1}}
    found = faults(pipeline(simulationBatch={"createSimulationJobRequests": [JOB], "matrix": matrix}))
    assert found["simulationBatch.matrix.environmentVariables.SPEED"][1] == 'a list; write SPEED: ["0.3"]'
    assert found["simulationBatch.matrix.physics.robot.mass"][1] == "a list; write robot.mass: [1.1]"


def test_numbers_alone_where_an_object_belongs_are_told_with_the_key_that_takes_them():
    search = {"over": {"SPEED": [0.2, 0.8]}, "find": 5, "budget": 2000}
    batch = {"createSimulationJobRequests": [JOB], "matrix": {"environmentVariables": {"SPEED": ["0.5"]}}}
    found = faults(pipeline(simulationBatch=batch, search=search, gate={"successRate": 0.9}))
    assert found["search.over.SPEED"][1].endswith("write SPEED: {uniform: [0.2, 0.8]}")
    assert found["search.find"][1].endswith("write find: {distinct: 5}")
    assert found["search.budget"][1].endswith("write budget: {episodes: 2000}")
    assert found["gate.successRate"][1].endswith("write successRate: {atLeast: 0.9}")


@pytest.mark.parametrize(
    ("name", "given", "told"),
    [
        ("start", "anywhere", "start: anywhere"),
        ("goals", "shares", "goals: shares"),
        ("goals", ["sofa"], "goals: scenario"),
        ("goals.x1_share", {"uniform": [0, 1]}, "goals.x1_share: {uniform: [...]}"),
    ],
)
def test_what_a_search_varies_beside_over_is_told_to_stand_below_it(name: str, given: object, told: str):
    search = {"over": {"robot.mass": {"uniform": [0.9, 1.1]}}, name: given}
    found = faults(pipeline(simulationBatch={"createSimulationJobRequests": [JOB]}, search=search))
    assert found[f"search.{name}"][1] == f"below over, where all stands that varies: over: {{{told}}}"


def test_a_world_that_is_no_name_is_told_with_the_command_that_lists_worlds():
    for worlds in ("office", ["office"]):
        found = faults(pipeline(simulationBatch={"createSimulationJobRequests": [JOB], "matrix": {"worlds": worlds}}))
        ((_, allowed),) = [said for path, said in found.items() if path.startswith("simulationBatch.matrix")]
        assert "simyard list worlds" in allowed


def test_a_wrong_word_is_told_with_the_words_that_may_stand_there():
    room = {"Type": "Bedrom", "Name": "A"}
    body = {"Buildings": [{"Floors": [{"Floorplan": {"Rooms": [room]}}]}]}

    assert faults(pipeline(worldGeneration={**GENERATION, "template": body})) == {
        "worldGeneration.template.Buildings[0].Floors[0].Floorplan.Rooms[0].Type": (
            '"Bedrom"',
            'did you mean "Bedroom"? one of Bedroom, Bathroom, Living, Dining, Kitchen, Hallway, Closet',
        )
    }


def test_a_number_out_of_bounds_is_told_with_both_bounds():
    request = {
        "clientRequestToken": "t",
        "fleet": "arn:f",
        "deploymentConfig": {"concurrentDeploymentPercentage": 500, "failureThresholdPercentage": 0},
        "deploymentApplicationConfigs": [
            {"application": "arn:a", "applicationVersion": "1", "launchConfig": {"packageName": "a", "launchFile": "b"}}
        ],
    }

    assert faults(request, CreateDeploymentJobRequest) == {
        "deploymentConfig.concurrentDeploymentPercentage": ("500", "from 1 to 100"),
        "deploymentConfig.failureThresholdPercentage": ("0", "from 1 to 100"),
    }


@pytest.mark.parametrize(
    ("value", "allowed"),
    [(1, 'text; write "1" in quotes'), (True, "text"), (["1"], "text"), (1.5, 'text; write "1.5" in quotes')],
)
def test_a_number_where_text_belongs_is_told_to_be_quoted(value: object, allowed: str):
    job = {
        "maxJobDurationInSeconds": 60,
        "robotApplications": [{"application": "a", "applicationVersion": value, "launchConfig": {}}],
    }

    ((_, found),) = faults(pipeline(simulationBatch={"createSimulationJobRequests": [job]})).values()

    assert found == allowed


def test_version_1_without_quotes_is_told_to_be_quoted():
    assert faults({"Version": 1}, TemplateBody) == {"Version": ("1", 'text; write "1" in quotes')}


@pytest.mark.parametrize("value", ["60", True, 60.5])
def test_what_is_no_whole_number_is_refused_and_not_converted(value: object):
    batch = {"createSimulationJobRequests": [{"maxJobDurationInSeconds": value}]}

    ((path, (_, allowed)),) = faults(pipeline(simulationBatch=batch)).items()

    assert path == "simulationBatch.createSimulationJobRequests[0].maxJobDurationInSeconds"
    assert allowed.startswith("a whole number")


def test_centimetres_are_told_the_metres_to_write():
    section: JsonValue = {"template": "t", "worldCount": {"floorplanCount": 1}, "robotRadius": 25}
    with pytest.raises(DocumentError, match=r"robotRadius: 25: from 0.05 to 0.6 metres; write 0.25 for 25 cm$"):
        parse(WorldGeneration, section, "source")


@pytest.mark.parametrize(
    ("rule", "allowed"),
    [
        ({"atLeast": 90}, "less than 1; write 0.9 for 90 %"),
        ({"atLeast": 1}, "less than 1"),
        ({"atLeast": 0.9, "confidence": 95}, "from 0.5 to 0.9999; write 0.95 for 95 %"),
    ],
)
def test_percents_are_told_the_share_to_write(rule: dict[str, JsonValue], allowed: str):
    found = faults(pipeline(simulationBatch={"createSimulationJobRequests": []}, gate={"successRate": rule}))
    assert allowed in {said for path, (_, said) in found.items() if path.startswith("gate")}


def test_an_empty_section_does_not_pass_for_a_section_left_out():
    assert faults(pipeline(gate=None)) == {"gate": ("nothing", "a value, indented below the key; or leave the key out")}


def test_a_missing_key_is_told_by_its_own_path():
    assert faults({"name": "nightly", "worldGeneration": {"worldCount": {}}}) == {
        "worldGeneration.template": ("missing", "required")
    }


def test_a_document_that_is_no_object_is_refused():
    keys = "name, applications, worlds, worldGeneration, worldExport, simulationBatch, search, gate, deployment"
    allowed = f"an object with keys {keys}"

    assert faults([1]) == {"document": ("[1]", allowed)}


def test_all_faults_of_a_document_are_told_at_once():
    connections = [
        {"Location": ["A", "B"], "ConnectionType": "Opening"},
        {"Location": ["B", "A"], "ConnectionType": "Doorway"},
    ]
    rooms = [{"Type": "Sauna", "Name": "A"}, {"Type": "Living", "Name": "B"}]
    template = {"Buildings": [{"Floors": [{"Floorplan": {"Rooms": rooms, "DesiredConnections": connections}}]}]}
    plan = "worldGeneration.template.Buildings[0].Floors[0].Floorplan"

    found = faults(
        {
            "name": "my nights",
            "worldGeneration": {"template": template, "worldCount": {"floorplanCount": 10_001}, "sead": 1},
            "worldExport": {"formats": ["mjfc"], "outputLocation": {"s3Bucket": "B"}},
            "gate": {"successRate": {"atLeast": 2}},
        }
    )

    assert sorted(found) == sorted(
        [
            "name",
            f"{plan}.Rooms[0].Type",
            f"{plan}.DesiredConnections[1].ConnectionType",
            "worldGeneration.worldCount",
            "worldGeneration.sead",
            "worldExport.formats[0]",
            "worldExport.outputLocation.s3Bucket",
            "gate.successRate.atLeast",
            "gate",
        ]
    )


def test_faults_in_a_wrapped_body_have_the_wrappers_path():
    wrapped = {"name": "Flat", "templateBody": {"Buildings": [{"Flors": []}]}}

    assert faults(wrapped, TemplateBody) == {
        "templateBody.Buildings[0].Flors": ("unknown key", 'did you mean "Floors"? known keys are Floors')
    }


def test_a_body_in_text_is_told_with_the_keys_of_a_body():
    body = json.dumps(
        {"Buildings": [{"Floors": [{"Floorplan": {"Rooms": [{"Type": "Living", "Name": "A", "DesiredShpae": {}}]}}]}]}
    )

    ((path, (value, allowed)),) = faults({"name": "Flat", "templateBody": body}, CreateWorldTemplateRequest).items()
    assert path == "templateBody.Buildings[0].Floors[0].Floorplan.Rooms[0].DesiredShpae"
    assert value == "unknown key"
    assert allowed.startswith('did you mean "DesiredShape"? known keys are Type, Name')


def test_text_that_is_no_json_is_told_with_its_place():
    ((_, (_, allowed)),) = faults(
        {"templateBody": '{"Version": "1",\n "Buildings": [}'}, CreateWorldTemplateRequest
    ).items()
    assert "no JSON at line 2, column 16: Expecting value" in allowed
    deep = "[" * 20_000
    ((_, (_, allowed)),) = faults({"templateBody": deep}, CreateWorldTemplateRequest).items()
    assert "nested too deep" in allowed


def test_long_values_are_shortened_and_control_characters_escaped():
    ((value, _),) = faults(pipeline(name="\x1b[31m" + "x" * 200)).values()

    assert len(value) <= 60
    assert value.isprintable()


def test_more_faults_than_a_person_reads_are_counted():
    data = pipeline(simulationBatch={"createSimulationJobRequests": [{"x": 1}] * 300})

    assert faults(data)["document"] == ("500 faults more", "correct these first")


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.text(max_size=5),
        lambda below: (
            st.lists(below, max_size=3)
            | st.dictionaries(
                st.sampled_from(
                    [
                        "name",
                        "worldGeneration",
                        "template",
                        "templateBody",
                        "Buildings",
                        "matrix",
                        "simulationBatch",
                        "worlds",
                        "x",
                    ]
                ),
                below,
                max_size=4,
            )
        ),
        max_leaves=12,
    )
)
@settings(deadline=None)
def test_any_data_is_parsed_or_refused_with_faults(data: JsonValue):
    for model in (PipelineSpec, TemplateBody):
        try:
            parse(model, data)
        except DocumentError as exc:
            assert exc.faults  # noqa: PT017 - either outcome is right, a crash is not


def test_faults_that_nobody_would_read_are_only_counted():
    data: dict[str, Any] = {"jobs": [{}] * 6000}
    told = {"document": ("6,001 faults", "a BatchDescribeSimulationJobRequest")}
    assert faults(data, BatchDescribeSimulationJobRequest) == told


TABLE = ROOT / "tests/documents/template_faults.txt"


def told(body: Body) -> list[str]:
    """Returns the faults of a template, a line each."""
    with pytest.raises(DocumentError) as caught:
        parse(TemplateBody, body)
    return [str(fault) for fault in caught.value.faults]


def recorded() -> dict[str, list[str]]:
    """Returns what stands in the table, by case."""
    cases = TABLE.read_text().strip().split("\n\n")
    return {name: lines for name, *lines in (case.splitlines() for case in cases)}


def test_every_case_stands_in_the_table_and_no_other():
    assert list(recorded()) == list(BEGINNERS)


@pytest.mark.parametrize("name", BEGINNERS)
def test_a_beginner_is_told_what_the_table_says(name: str):
    assert told(BEGINNERS[name]) == recorded()[name]


def test_a_key_in_other_capitals_does_not_hide_what_is_below_it():
    floor: Body = {"floorplan": {"rooms": [{"type": "Attic", "name": "A"}]}, "interior": {"wals": {}}}
    places = [line.split(": ")[0].rpartition(".")[2] for line in told({"buildings": [{"floors": [floor]}]})]
    assert places == ["buildings", "floors", "floorplan", "interior", "rooms", "wals", "type", "name", "Type"]


def test_what_is_moved_in_thought_never_covers_what_stands_there():
    body: Body = {"Rooms": [], "Buildings": [{"Floors": [{"Floorplan": {"Rooms": [{"Type": "Attic", "Name": "A"}]}}]}]}
    assert {line.split(": ")[0] for line in told(body)} == {"Rooms", "Buildings[0].Floors[0].Floorplan.Rooms[0].Type"}


def test_the_document_that_was_read_is_left_as_it_is():
    body: Body = {"buildings": [], "Rooms": []}
    told(body)
    assert body == {"buildings": [], "Rooms": []}
