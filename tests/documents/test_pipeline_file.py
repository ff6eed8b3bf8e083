"""A pipeline document is read with the files beside it, and RoboMaker's own requests run as they stand."""

import json
from pathlib import Path
from typing import Any

import pytest

from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec, inert_fields
from tasks.documents.pipeline_file import names_a_file, read_pipeline
from tests.repository import ROOT

DOCUMENT = """
name: nightly
worldGeneration: {template: templates/flat.json, worldCount: {floorplanCount: 2}}
"""


def written(folder: Path, document: str, template: str | None = '{"Version": "1"}') -> Path:
    (folder / "templates").mkdir()
    if template is not None:
        (folder / "templates" / "flat.json").write_text(template)
    (folder / "pipeline.yaml").write_text(document)
    return folder / "pipeline.yaml"


def faults(path: Path) -> list[tuple[str, str, str]]:
    with pytest.raises(DocumentError) as caught:
        read_pipeline(path)
    return [(fault.path, fault.value, fault.allowed) for fault in caught.value.faults]


def test_paths_in_the_document_stay_as_they_stand(tmp_path: Path):
    spec = read_pipeline(written(tmp_path, DOCUMENT))

    assert spec.worldGeneration is not None
    assert spec.worldGeneration.template == "templates/flat.json"


def test_a_missing_template_is_told_once_with_its_path(tmp_path: Path):
    assert faults(written(tmp_path, DOCUMENT, template=None)) == [
        (
            "worldGeneration.template",
            "templates/flat.json: there is no such file",
            "a YAML or JSON document of at most 1 MiB",
        )
    ]


def test_faults_of_the_template_are_told_beside_those_of_the_document(tmp_path: Path):
    path = written(tmp_path, DOCUMENT.replace("nightly", "my night"), '{"Version": "3"}')

    assert [fault[:2] for fault in faults(path)] == [
        ("name", '"my night"'),
        ("worldGeneration.template", 'templates/flat.json: Version: "3"'),
    ]


def test_what_is_not_launched_is_told_beside_the_faults_of_its_job(tmp_path: Path):
    scenario = "{application: a, launchConfig: {launchFile: x}}"
    job = f"{{maxJobDurationInSeconds: -1, robotApplications: [], simulationApplications: [{scenario}]}}"
    path = written(tmp_path, f"name: n\nsimulationBatch: {{createSimulationJobRequests: [{job}]}}\n")
    where = "simulationBatch.createSimulationJobRequests[0]"
    assert [fault[0] for fault in faults(path) if fault[0].startswith(where)] == [
        f"{where}.maxJobDurationInSeconds",
        f"{where}.robotApplications",
        f"{where}.simulationApplications[0].launchConfig.packageName",
    ]


def test_a_template_file_without_content_is_refused(tmp_path: Path):
    assert faults(written(tmp_path, DOCUMENT.replace(".json", ".yaml"), template=None))


def test_a_source_that_is_no_folder_is_refused(tmp_path: Path):
    path = written(tmp_path, DOCUMENT + "applications: [{name: courier, source: nowhere}]")

    assert [fault[:2] for fault in faults(path)] == [("applications[0].source", "nowhere")]


@pytest.mark.parametrize("template", ["templates/flat.json", "flat.json", "../flat"])
def test_a_template_with_a_folder_or_a_suffix_is_a_file(template: str):
    assert names_a_file(template)


@pytest.mark.parametrize("template", ["flat", "s3://b/flat.json", "arn:simyard:world-template:s1:flat", '{"a": 1.0}'])
def test_a_name_a_url_an_arn_and_a_body_are_no_file(template: str):
    assert not names_a_file(template)


def test_the_example_is_valid():
    assert read_pipeline(ROOT / "examples" / "quickstart.yaml").name == "apartment-regression"


@pytest.mark.parametrize("key", ["Buildings", "buildings", "Rooms", "templateBody"])
def test_a_template_alone_is_told_what_makes_worlds_of_it(tmp_path: Path, key: str):
    file = tmp_path / "home.yaml"
    file.write_text(f"{key}: []\n")

    with pytest.raises(DocumentError) as caught:
        read_pipeline(file)

    (fault,) = caught.value.faults
    assert fault.value == "a template alone"
    assert "worldGeneration: {template: home.yaml" in fault.allowed


def test_a_document_with_a_section_is_never_taken_for_a_template(tmp_path: Path):
    file = tmp_path / "home.yaml"
    file.write_text("name: a\nworldGeneration: {}\nVersion: 1\n")

    with pytest.raises(DocumentError) as caught:
        read_pipeline(file)

    assert {fault.path for fault in caught.value.faults} >= {"Version", "worldGeneration.worldCount"}


REQUESTS = ROOT / "tests" / "data/samples/requests"
WORLD = "arn:aws:robomaker:us-west-2:111111111111:world/generation-1/world-1"


def sample(name: str) -> dict[str, Any]:
    return json.loads((REQUESTS / f"{name}.json").read_text())


def in_world(request: dict[str, Any]) -> dict[str, Any]:
    """Returns a sample with a world for its scenario: the printed ones bring a world file of their own."""
    for scenario in request["simulationApplications"]:
        scenario["worldConfigs"] = [{"world": WORLD}]
    return request


def read(folder: Path, request: dict[str, Any], name: str = "request.json") -> PipelineSpec:
    (folder / name).write_text(json.dumps(request))
    return read_pipeline(folder / name)


@pytest.mark.parametrize("name", ["create-simulation-job.guide", "create-simulation-job.vpc"])
def test_a_single_job_is_a_pipeline_of_one_request(tmp_path: Path, name: str):
    spec = read(tmp_path, {**in_world(sample(name)), "clientRequestToken": "mine"}, f"{name}.json")
    section = spec.simulationBatch
    assert section
    assert (spec.name, section.operation, section.clientRequestToken) == (
        name.replace(".", "-"),
        "CreateSimulationJob",
        "mine",
    )
    (request,) = section.createSimulationJobRequests
    kept = request.model_dump(mode="json", exclude_none=True)
    assert kept == in_world(sample(name))


def test_a_batch_is_a_pipeline_with_the_same_requests(tmp_path: Path):
    document = sample("start-simulation-job-batch")
    for request in document["createSimulationJobRequests"]:
        in_world(request)
    section = read(tmp_path, document).simulationBatch
    assert section
    kept = section.model_dump(mode="json", exclude_none=True, exclude_unset=True)
    assert kept == document
    assert section.operation == "StartSimulationJobBatch"


def test_fields_without_effect_are_accepted_and_named(tmp_path: Path):
    spec = read(tmp_path, in_world(sample("create-simulation-job.vpc")))
    where = "simulationBatch.createSimulationJobRequests[*]"
    assert inert_fields(spec) == [f"{where}.vpcConfig", f"{where}.iamRole"]


def test_a_fault_is_told_where_it_stands_in_the_request(tmp_path: Path):
    job = in_world(sample("create-simulation-job.guide"))
    with pytest.raises(DocumentError) as refused:
        read(tmp_path, {**job, "maxJobDurationInSeconds": 1_209_601, "failureBehavior": "Stop"})
    assert [fault.path for fault in refused.value.faults] == ["failureBehavior", "maxJobDurationInSeconds"]
    batch = sample("start-simulation-job-batch")
    in_world(batch["createSimulationJobRequests"][0])["maxJobDurationInSeconds"] = 700_000
    in_world(batch["createSimulationJobRequests"][1])
    with pytest.raises(DocumentError) as refused:
        read(tmp_path, batch)
    (fault,) = refused.value.faults
    assert fault.path == "createSimulationJobRequests[0].maxJobDurationInSeconds"


def test_a_request_without_a_world_is_told_where_to_name_one(tmp_path: Path):
    job = sample("create-simulation-job.guide")
    assert read(tmp_path, job).simulationBatch is not None  # its simulation application's launch file may bring one
    job["simulationApplications"][0]["launchConfig"]["launchFile"] = "rooms"
    with pytest.raises(DocumentError, match="worldConfigs in every request") as refused:
        read(tmp_path, job)
    assert len(refused.value.faults) == 1


def test_a_file_whose_name_is_no_name_still_names_its_pipeline(tmp_path: Path):
    job = in_world(sample("create-simulation-job.guide"))
    assert read(tmp_path, job, "_ä job (2).json").name == "job-2"
    assert read(tmp_path, job, "___.json").name == "request"


@pytest.mark.parametrize(
    ("request_file", "section"),
    [
        ("create-deployment-job.json", "deployment"),
        ("create-world-generation-job.json", "worldGeneration"),
        ("create-world-export-job.json", "worldExport"),
    ],
)
def test_a_request_alone_is_told_where_it_belongs(request_file: str, section: str):
    with pytest.raises(DocumentError, match=f"below `{section}:`") as refused:
        read_pipeline(REQUESTS / request_file)
    assert len(refused.value.faults) == 1


def test_the_same_request_below_its_section_is_a_document(tmp_path: Path):
    request = json.loads((REQUESTS / "create-world-generation-job.json").read_text())
    (tmp_path / "document.json").write_text(json.dumps({"name": "old", "worldGeneration": request}))
    assert read_pipeline(tmp_path / "document.json").worldGeneration is not None
