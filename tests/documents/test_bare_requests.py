"""RoboMaker's own simulation requests, handed to `simyard` as they stand."""

import json
from pathlib import Path
from typing import Any

import pytest

from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec, inert_fields
from tasks.documents.pipeline_file import read_pipeline
from tests.repository import ROOT

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
    with pytest.raises(DocumentError, match="worldConfigs in every request") as refused:
        read(tmp_path, sample("create-simulation-job.guide"))
    assert len(refused.value.faults) == 1


def test_a_file_whose_name_is_no_name_still_names_its_pipeline(tmp_path: Path):
    job = in_world(sample("create-simulation-job.guide"))
    assert read(tmp_path, job, "_ä job (2).json").name == "job-2"
    assert read(tmp_path, job, "___.json").name == "request"
