import json
from pathlib import Path

import pytest

from specs.base import canonical_document
from specs.pipeline.document import PipelineSpec, inert_fields
from specs.template.body import template_body
from tests.repository import ROOT
from tests.specs.contract_forms import models

SAMPLES = ROOT / "tests" / "data" / "samples"
REQUESTS = {
    "batch-delete-worlds": "BatchDeleteWorldsRequest",
    "create-deployment-job": "CreateDeploymentJobRequest",
    "create-fleet": "CreateFleetRequest",
    "create-robot-application": "CreateRobotApplicationRequest",
    "create-simulation-application": "CreateSimulationApplicationRequest",
    "create-simulation-job.guide": "CreateSimulationJobRequest",
    "create-simulation-job.vpc": "CreateSimulationJobRequest",
    "create-world-export-job": "CreateWorldExportJobRequest",
    "create-world-generation-job": "CreateWorldGenerationJobRequest",
    "register-robot": "RegisterRobotRequest",
    "start-simulation-job-batch": "StartSimulationJobBatchRequest",
    "sync-deployment-job": "SyncDeploymentJobRequest",
}


def request(name: str):
    return json.loads((SAMPLES / "requests" / f"{name}.json").read_text())


@pytest.mark.parametrize("file", sorted((SAMPLES / "requests").iterdir()), ids=lambda file: file.stem)
def test_a_sample_request_is_read_and_written_unchanged(file: Path):
    document = json.loads(file.read_text())

    assert canonical_document(models()[REQUESTS[file.stem]].model_validate(document)) == document


@pytest.mark.parametrize("file", sorted((SAMPLES / "templates").iterdir()), ids=lambda file: file.stem)
def test_a_sample_template_keeps_all_that_it_says(file: Path):
    document = json.loads(file.read_text())

    body = template_body(document)

    assert body.model_dump(mode="json", exclude_unset=True) == document


def test_sample_requests_stand_in_a_pipeline_as_they_are():
    sections = {
        "worldGeneration": request("create-world-generation-job"),
        "worldExport": request("create-world-export-job"),
        "simulationBatch": request("start-simulation-job-batch"),
        "deployment": request("create-deployment-job"),
    }

    spec = PipelineSpec.model_validate({"name": "samples", **sections})

    assert spec.model_dump(mode="json", exclude_unset=True) == {"name": "samples", **sections}
    assert inert_fields(spec) == ["worldExport.iamRole", "simulationBatch.createSimulationJobRequests[*].iamRole"]


def test_a_template_request_may_print_the_body_as_an_object():
    body = json.loads((SAMPLES / "templates" / "two-rooms.body.json").read_text())

    created = models()["CreateWorldTemplateRequest"].model_validate({"name": "Two rooms", "templateBody": body})

    assert template_body(canonical_document(created)["templateBody"]) == template_body(body)
