from typing import Any

import pytest
from pydantic import ValidationError

from specs.base import canonical_document, digest
from specs.pipeline.document import PipelineSpec, canonical_digest, inert_fields, place_worlds
from specs.pipeline.search_section import Search
from specs.pipeline.world_sections import FORMATS

JOB: dict[str, Any] = {
    "maxJobDurationInSeconds": 60,
    "robotApplications": [{"application": "courier", "launchConfig": {}}],
    "simulationApplications": [{"application": "delivery", "launchConfig": {}}],
}
GENERATION = {"template": "two-rooms", "worldCount": {"floorplanCount": 2}}
BATCH = {"createSimulationJobRequests": [JOB]}
PLACE = {"s3Bucket": "worlds"}
DEPLOYMENT: dict[str, Any] = {
    "fleet": "couriers",
    "deploymentApplicationConfigs": [
        {"application": "courier", "launchConfig": {"packageName": "courier", "launchFile": "run.sh"}}
    ],
}


def spec(**sections: object) -> PipelineSpec:
    return PipelineSpec.model_validate({"name": "nightly", **sections})


def faults(**sections: object) -> list[tuple[str, str]]:
    with pytest.raises(ValidationError) as caught:
        spec(**sections)
    return [(".".join(map(str, error["loc"])), error["msg"]) for error in caught.value.errors()]


def test_a_pipeline_with_nothing_to_do_is_refused():
    assert [place for place, _ in faults(applications=[])] == [""]


def test_a_gate_needs_a_batch():
    gate = {"successRate": {"atLeast": 0.9}}

    assert faults(worldGeneration=GENERATION, gate=gate) == [
        ("gate", "simulationBatch beside it, whose results it judges")
    ]
    spec(worldGeneration=GENERATION, simulationBatch=BATCH, gate=gate)


def test_a_batch_without_generation_must_name_its_worlds():
    assert [place for place, _ in faults(simulationBatch=BATCH)] == ["simulationBatch.matrix.worlds"]
    spec(simulationBatch={**BATCH, "matrix": {"worlds": ["night-1/world-1-1"]}})


def test_a_request_may_bring_its_own_world():
    world = {"worldConfigs": [{"world": "night-1/world-1-1"}]}
    job = {**JOB, "simulationApplications": [{"application": "delivery", "launchConfig": {}, **world}]}

    spec(simulationBatch={"createSimulationJobRequests": [job]})
    assert faults(simulationBatch={"createSimulationJobRequests": [job, JOB]})


def test_an_export_without_generation_must_name_its_worlds():
    assert [place for place, _ in faults(worldExport={"outputLocation": PLACE})] == ["worldExport.worlds"]
    spec(worldExport={"outputLocation": PLACE, "worlds": ["arn:aws:robomaker:us-west-2:1:world/A/B"]})


@pytest.mark.parametrize(("plans", "interiors"), [(10_001, 1), (101, 100)])
def test_more_than_10_000_worlds_are_refused_before_anything_runs(plans: int, interiors: int):
    count = {"floorplanCount": plans, "interiorCountPerFloorplan": interiors}

    ((place, allowed),) = faults(worldGeneration={**GENERATION, "worldCount": count})

    assert place == "worldGeneration.worldCount"
    assert allowed.startswith("at most 10000 worlds; ")


def test_an_export_of_more_worlds_than_a_job_writes_is_refused():
    generation = {**GENERATION, "worldCount": {"floorplanCount": 101}}

    ((place, allowed),) = faults(worldGeneration=generation, worldExport={"outputLocation": PLACE})

    assert (place, allowed) == ("worldExport.worlds", "at most 100 worlds, by name; 101 are generated")
    spec(worldGeneration=generation)


@pytest.mark.parametrize(("plans", "interiors"), [(10, 5), (384, 1), (1, 51)])
def test_a_document_may_ask_for_more_worlds_than_one_job_makes(plans: int, interiors: int):
    count = {"floorplanCount": plans, "interiorCountPerFloorplan": interiors}
    spec(worldGeneration={**GENERATION, "worldCount": count})


def test_all_formats_are_known_by_name_and_no_other():
    spec(worldGeneration=GENERATION, worldExport={"outputLocation": PLACE, "formats": list(FORMATS)})
    errors = dict(faults(worldGeneration=GENERATION, worldExport={"outputLocation": PLACE, "formats": ["fbx"]}))
    assert all(name in errors["worldExport.formats.0"] for name in FORMATS)


def test_an_output_location_needs_a_bucket():
    assert faults(worldGeneration=GENERATION, worldExport={"outputLocation": {"s3Prefix": "a"}}) == [
        ("worldExport.outputLocation", "a place with s3Bucket")
    ]


@pytest.mark.parametrize("seeds", [0, True, "8", [1, 1], [], [-1], 1.5])
def test_seeds_are_a_positive_number_or_different_numbers(seeds: object):
    assert faults(worldGeneration=GENERATION, simulationBatch={**BATCH, "matrix": {"seeds": seeds}})


def test_an_application_is_published_once():
    twice = [{"name": "courier", "source": "a"}, {"name": "courier", "kind": "robot", "source": "b"}]

    assert [place for place, _ in faults(applications=twice)] == ["applications.1.name"]
    spec(applications=[{"name": "courier", "source": "a"}, {"name": "courier", "kind": "simulation", "source": "b"}])


def test_a_demonstration_fleet_has_at_most_20_agents():
    spec(deployment={**DEPLOYMENT, "fleet": {"name": "couriers", "localAgents": 20}})
    assert faults(deployment={**DEPLOYMENT, "fleet": {"name": "couriers", "localAgents": 21}})


@pytest.mark.parametrize("version", ["$LATEST", 1, "one"])
def test_a_deployment_names_a_numbered_version_or_none(version: object):
    application = {**DEPLOYMENT["deploymentApplicationConfigs"][0], "applicationVersion": version}

    assert faults(deployment={**DEPLOYMENT, "deploymentApplicationConfigs": [application]})


def test_equal_documents_have_equal_digests_however_they_are_written():
    short = spec(worldGeneration=GENERATION, simulationBatch=BATCH)
    long = spec(
        simulationBatch={"engine": "auto", "matrix": {"worlds": "all", "seeds": 1}, **BATCH},
        worldGeneration={"seed": 0, **GENERATION},
    )

    assert canonical_digest(short) == canonical_digest(long)
    assert canonical_digest(short) != canonical_digest(spec(worldGeneration={**GENERATION, "seed": 1}))


def test_fields_that_only_aws_had_are_named_and_tags_are_not_searched_for_them():
    job = {**JOB, "iamRole": "arn:aws:iam::1:role/a", "compute": {}, "tags": {"command": "x"}}

    named = inert_fields(spec(worldGeneration=GENERATION, simulationBatch={"createSimulationJobRequests": [job, job]}))

    assert named == [
        "simulationBatch.createSimulationJobRequests[*].compute",
        "simulationBatch.createSimulationJobRequests[*].iamRole",
    ]


@pytest.mark.parametrize(("values", "named"), [(["0.3", "0.4"], 1), (["0.4", "0.5"], 0)])
def test_a_variable_that_the_matrix_replaces_and_never_drives_has_no_effect(values: list[str], named: int):
    (robot,) = JOB["robotApplications"]
    launch = {**robot["launchConfig"], "environmentVariables": {"MAX_SPEED": "0.5"}}
    job = {**JOB, "robotApplications": [{**robot, "launchConfig": launch}]}
    matrix = {"worlds": "all", "seeds": 1, "environmentVariables": {"MAX_SPEED": values}}
    document = spec(
        worldGeneration=GENERATION, simulationBatch={"matrix": matrix, "createSimulationJobRequests": [job, job]}
    )
    where = "robotApplications[*].launchConfig.environmentVariables.MAX_SPEED"
    assert inert_fields(document) == [f"simulationBatch.createSimulationJobRequests[*].{where}"][:named]


def test_the_schema_for_prefects_form_has_titles_and_lists_every_section():
    schema = PipelineSpec.model_json_schema()

    assert set(schema["properties"]) == set(PipelineSpec.model_fields)
    assert schema["$defs"]["WorldGeneration"]["properties"]["seed"]["title"] == "Seed"


@pytest.mark.parametrize(
    "named",
    [
        {"untestedBuilds": {"ARM64": {"testedAs": "X86_64", "digest": "a" * 64}}},
        {"untestedVariables": {"SPEED": "kilometres an hour on robots"}},
    ],
)
def test_what_ships_untested_is_named_beside_a_gate_alone(named: dict[str, Any]):
    sections = {"worldGeneration": GENERATION, "simulationBatch": BATCH, "deployment": {**DEPLOYMENT, **named}}
    (place,) = [place for place, _ in faults(**sections)]
    assert place == f"deployment.{next(iter(named))}"
    spec(**sections, gate={"successRate": {"atLeast": 0.9}})


def test_a_document_that_asks_for_no_bags_keeps_its_digest():
    assert "bags" not in str(canonical_document(spec(worldGeneration=GENERATION, simulationBatch=BATCH)))


def test_a_document_that_names_nothing_untested_keeps_its_digest():
    assert "untested" not in str(canonical_document(spec(deployment=DEPLOYMENT)))


@pytest.mark.parametrize(
    "named",
    [
        {"untestedBuilds": {"ARM": {"testedAs": "X86_64", "digest": "a" * 64}}},
        {"untestedBuilds": {"ARM64": {"testedAs": "X86_64", "digest": "a" * 12}}},
        {"untestedBuilds": {"ARM64": {"digest": "a" * 64}}},
        {"untestedVariables": {"SPEED": ""}},
    ],
)
def test_a_build_is_named_by_its_whole_digest_and_a_variable_with_a_reason(named: dict[str, Any]):
    gate = {"successRate": {"atLeast": 0.9}}
    assert faults(worldGeneration=GENERATION, simulationBatch=BATCH, gate=gate, deployment={**DEPLOYMENT, **named})


OWN = {"name": "hall", "source": "maps/hall.yaml"}


def test_imported_worlds_are_all_that_a_batch_needs():
    spec(worlds=[OWN], simulationBatch=BATCH)
    spec(worlds=[OWN], simulationBatch={**BATCH, "matrix": {"worlds": ["hall"]}}, worldExport={"outputLocation": PLACE})


def test_a_document_without_imported_worlds_is_what_it_was():
    assert "worlds" not in canonical_document(spec(worldGeneration=GENERATION))


def test_two_imported_worlds_have_two_names():
    assert faults(worlds=[OWN, OWN]) == [("worlds.1.name", "a name of its own among the worlds and their variants")]


@pytest.mark.parametrize(
    ("entry", "place", "said"),
    [
        ({"source": "hall.pgm"}, "source", "a file that ends in one of .yaml, .yml, .world, "),
        ({"unit": "cm"}, "unit", "nothing for maps/hall.yaml: it is for .glb, .stl, "),
        ({"models": ["models"]}, "models", "nothing for maps/hall.yaml: it is for .world, .sdf"),
        ({"source": "hall.world", "wallHeight": 2.0}, "wallHeight", "nothing for hall.world: it is for .yaml, .yml"),
        ({"wallHeight": 0.0}, "wallHeight", "greater than 0"),
        ({"start": [1.0]}, "start", "at least 2 items"),
    ],
)
def test_what_a_source_does_not_have_is_refused(entry: dict[str, object], place: str, said: str):
    ((found, allowed),) = faults(worlds=[{**OWN, **entry}])
    assert found == f"worlds.0.{place}"
    assert said in allowed


def test_a_name_that_no_imported_world_has_is_refused_wherever_it_stands():
    config = {"worldConfigs": [{"world": "ball"}]}
    job = {**JOB, "simulationApplications": [{"application": "delivery", "launchConfig": {}, **config}]}
    batch = {"createSimulationJobRequests": [job], "matrix": {"worlds": ["hall", "ball"]}}
    export = {"outputLocation": PLACE, "worlds": ["mall"]}
    allowed = 'hall; "<generation>/<world>", an ARN'
    config_path = "simulationBatch.createSimulationJobRequests.0.simulationApplications.0.worldConfigs.0.world"
    assert faults(worlds=[OWN], simulationBatch=batch, worldExport=export) == [
        ("worldExport.worlds.0", allowed),
        ("simulationBatch.matrix.worlds.1", allowed),
        (config_path, allowed),
    ]


def test_all_in_a_list_is_refused_with_how_it_is_written():
    export = {"outputLocation": PLACE, "worlds": ["all"]}
    told = [("worldExport.worlds.0", "all without a list around it: worlds: all")]
    assert faults(worlds=[OWN], worldExport=export) == told


def test_one_imported_world_says_nothing_of_worlds_like_it():
    gate = {"successRate": {"atLeast": 0.9, "over": "worlds"}}
    assert [place for place, _ in faults(worlds=[OWN], simulationBatch=BATCH, gate=gate)] == ["gate.successRate.over"]
    many = [{"name": f"hall-{number}", "source": "hall.yaml"} for number in range(20)]
    spec(worlds=many, simulationBatch=BATCH, gate=gate)


def test_an_export_takes_a_hundred_worlds_imported_ones_among_them():
    generation = {"template": "two-rooms", "worldCount": {"floorplanCount": 100}}
    ((place, said),) = faults(worlds=[OWN], worldGeneration=generation, worldExport={"outputLocation": PLACE})
    assert (place, said) == ("worldExport.worlds", "at most 100 worlds, by name; 100 are generated, and 1 imported")


def test_variants_are_as_many_worlds_and_are_named_by_number():
    hall, gate = {**OWN, "variants": 20, "move": 0.3}, {"successRate": {"atLeast": 0.9, "over": "worlds"}}
    batch = {**BATCH, "matrix": {"worlds": ["hall", "hall-20"]}}
    spec(worlds=[hall], simulationBatch=BATCH, gate=gate)
    placed = place_worlds(spec(worlds=[hall], simulationBatch=batch), {"hall": ["v/1", "v/2"], "hall-20": ["v/2"]})
    assert placed.simulationBatch is not None
    assert placed.simulationBatch.matrix.worlds == ("v/1", "v/2")
    ((place, said),) = faults(worlds=[{**hall, "variants": 101}], worldExport={"outputLocation": PLACE})
    assert (place, said) == ("worldExport.worlds", "at most 100 worlds, by name; 0 are generated, and 101 imported")


def test_one_job_names_one_variant():
    config = {"worldConfigs": [{"world": "hall"}]}
    job = {**JOB, "simulationApplications": [{"application": "delivery", "launchConfig": {}, **config}]}
    ((_, said),) = faults(worlds=[{**OWN, "variants": 3}], simulationBatch={"createSimulationJobRequests": [job]})
    assert said.startswith("hall (hall-1 to hall-3); ")


def test_a_variant_has_a_name_of_its_own():
    worlds = [{**OWN, "variants": 3}, {**OWN, "name": "hall-2"}]
    assert [place for place, _ in faults(worlds=worlds)] == ["worlds.1.name"]


@pytest.mark.parametrize("field", ["seed", "move", "remove", "clutter"])
def test_what_variants_are_like_needs_some(field: str):
    ((place, said),) = faults(worlds=[{**OWN, field: 1}])
    assert (place, said) == (f"worlds.0.{field}", "variants beside it, of which it says what they are like")


def searched(**changes: object) -> dict[str, object]:
    return {"over": {"MAX_SPEED": {"uniform": [0.2, 0.8]}}, **changes}


def swept_batch(requests: int = 1) -> dict[str, object]:
    robot = {"application": "courier", "launchConfig": {"environmentVariables": {"ODOMETRY_SIGMA": "0.05"}}}
    job = {**JOB, "robotApplications": [robot]}
    matrix = {"worlds": ["a/b"], "environmentVariables": {"MAX_SPEED": ["0.5"]}}
    return {**BATCH, "createSimulationJobRequests": [job] * requests, "matrix": matrix}


def test_a_search_varies_what_the_request_or_the_matrix_sets():
    over = {"MAX_SPEED": {"uniform": [0.2, 0.8]}, "ODOMETRY_SIGMA": {"logUniform": [0.01, 0.1]}}
    assert spec(simulationBatch=swept_batch(), search=searched(over=over)).search is not None
    one = {"uniform": [0.0, 1.0]}
    found = faults(simulationBatch=swept_batch(), search=searched(over={"SPEED": one, "MASS": one}))
    allowed = "a variable that the batch's request or matrix sets: MAX_SPEED, ODOMETRY_SIGMA"
    assert found == [("search.over.SPEED", allowed), ("search.over.MASS", allowed)]


def test_a_request_with_a_seed_of_its_own_is_driven_once():
    own = {**JOB, "seed": 2**32 - 1}
    batch = {**BATCH, "createSimulationJobRequests": [JOB, own], "matrix": {"worlds": ["a/b"], "seeds": [3]}}
    assert spec(simulationBatch=batch).simulationBatch is not None
    found = faults(simulationBatch={**batch, "matrix": {"worlds": ["a/b"], "seeds": 2}})
    allowed = "nothing, or matrix.seeds 1: a request with a seed of its own is driven once"
    assert found == [("simulationBatch.createSimulationJobRequests.1.seed", allowed)]


def test_physical_parameters_are_factors_of_a_matrix_a_request_and_a_search():
    job = {**JOB, "physics": {"robot.friction": 0.5}}
    matrix = {"worlds": ["a/b"], "physics": {"robot.mass": [0.9, 1, 1.1]}, "environmentVariables": {"A": ["1"]}}
    batch = {**BATCH, "createSimulationJobRequests": [job], "matrix": matrix}
    search = searched(over={"robot.motorStrength": {"uniform": [0.8, 1.0]}})
    section = spec(simulationBatch=batch, search=search).simulationBatch
    assert section is not None
    assert section.matrix.sweep == {"A": ("1",), "robot.mass": ("0.9", "1", "1.1")}
    wrong = {"worlds": ["a/b"], "physics": {"robot.mass": [0.0], "robot.colour": [1]}}
    late = {**job, "physics": {"robot.controlDelay_s": 0.07}}
    asked = {**batch, "matrix": wrong, "createSimulationJobRequests": [late]}
    places = {place for place, _ in faults(simulationBatch=asked, search=search)}
    assert places >= {
        "simulationBatch.matrix.physics.robot.mass.0",
        "simulationBatch.createSimulationJobRequests.0.physics.robot.controlDelay_s",
    }
    assert any("robot.colour" in place for place in places)


def test_people_vary_where_a_batch_has_some():
    over = {"people.unaware": {"uniform": [0.0, 1.0]}}
    job = {**JOB, "physics": {"people.count": 2}}
    batch = {**BATCH, "createSimulationJobRequests": [job], "matrix": {"worlds": ["a/b"]}}
    spec(simulationBatch={**batch, "people": 4}, search=searched(over=over))
    allowed = "a batch with people: nobody walks in this one's worlds"
    assert sorted(faults(simulationBatch=batch, search=searched(over=over))) == [
        ("search.over.people.unaware", allowed),
        ("simulationBatch.createSimulationJobRequests.0.physics.people.count", allowed),
    ]
    ((place, _),) = faults(
        simulationBatch={**batch, "people": {"count": 4, "model": "recorded"}}, search=searched(over=over)
    )
    assert place == "search.over.people.unaware"


def test_a_search_may_begin_anywhere_and_name_what_varies_by_itself():
    over = {"start": "anywhere", "goals": "scenario", "worlds": "all", "start.yaw_rad": {"uniform": [0, 1]}}
    search = spec(simulationBatch=swept_batch(), search=searched(over=over)).search
    assert search is not None
    assert {name: each.uniform for name, each in search.over.items()} == {
        "start.x_share": (0.0, 1.0),
        "start.y_share": (0.0, 1.0),
        "start.yaw_rad": (0.0, 1.0),
    }
    assert type(search).model_validate(search.model_dump(mode="json")) == search


def test_a_search_may_draw_goals_by_shares():
    over = {"goals": "shares", "goals.y2_share": {"uniform": [0.2, 0.3]}}
    search = spec(simulationBatch=swept_batch(), search=searched(over=over)).search
    assert search is not None
    assert {name: each.uniform for name, each in search.over.items()} == {
        "goals.x1_share": (0.0, 1.0),
        "goals.y1_share": (0.0, 1.0),
        "goals.x2_share": (0.0, 1.0),
        "goals.y2_share": (0.2, 0.3),
    }
    ((place, _),) = faults(
        simulationBatch=swept_batch(), search=searched(over={"goals.x1_share": {"uniform": [0, 1.5]}})
    )
    assert place == "search.over.goals.x1_share"


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [("start", "somewhere", "anywhere"), ("goals", "mine", "scenario or shares"), ("worlds", "one", "all")],
)
def test_a_word_that_a_search_does_not_know_is_refused_with_the_one_that_it_knows(name: str, value: str, allowed: str):
    found = faults(simulationBatch=swept_batch(), search=searched(over={name: value}))
    assert [(place, message.rsplit(": ", 1)[-1]) for place, message in found] == [(f"search.over.{name}", allowed)]


def test_a_search_without_more_failures_has_the_digest_that_it_had_before_there_were_some():
    search = Search.model_validate(searched())
    assert canonical_document(search)["find"] == {"distinct": 20}
    explored = Search.model_validate(searched(find={"episodes": 128}))
    assert canonical_document(explored)["find"] == {"distinct": 20, "episodes": 128}
    assert Search.model_validate(canonical_document(explored)) == explored
    assert digest(explored) != digest(search)


def test_a_search_needs_a_batch_of_one_request():
    ((place, said),) = faults(worlds=[OWN], search=searched())
    assert (place, said) == ("search", "simulationBatch beside it, whose request and worlds it searches")
    ((place, said),) = faults(simulationBatch=swept_batch(2), search=searched())
    assert (place, said[:11]) == ("search", "one request")


def test_a_rule_about_rare_failures_needs_a_search_that_is_as_sure():
    gate = {"failureProbability": {"atMost": 0.001}}
    ((place, said),) = faults(simulationBatch=swept_batch(), gate=gate)
    assert (place, said) == ("gate.failureProbability", "a section search beside it, whose interval it judges")
    spec(simulationBatch=swept_batch(), gate=gate, search=searched())
    ((place, said),) = faults(simulationBatch=swept_batch(), gate=gate, search=searched(estimate={"confidence": 0.9}))
    assert place == "gate.failureProbability.confidence"
    assert said == "search.estimate.confidence, which is 0.9: the rule judges that interval"
