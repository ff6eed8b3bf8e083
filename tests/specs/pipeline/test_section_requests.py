from hypothesis import HealthCheck, given, settings

from specs.pipeline.document import PipelineSpec
from specs.pipeline.section_requests import (
    UNUSED_ROLE,
    batch_request,
    deployment_request,
    export_request,
    generation_request,
    reference_arn,
    section_parts,
)
from tests.factories.strategies import pipelines
from tests.specs.pipeline.test_document import DEPLOYMENT, GENERATION, JOB, PLACE

TEMPLATE = "arn:simyard:world-template:s1:two-rooms"
TOKEN = "nightly-1"  # noqa: S105 - an idempotency token, no secret
WORLD = "arn:aws:robomaker:us-west-2:1:world/A/B"


def full() -> PipelineSpec:
    batch = {"createSimulationJobRequests": [JOB], "outputLocation": PLACE, "batchPolicy": {"maxConcurrency": 2}}
    export = {"outputLocation": PLACE, "clientRequestToken": "mine"}
    return PipelineSpec.model_validate(
        {
            "name": "nightly",
            "worldGeneration": GENERATION,
            "worldExport": export,
            "simulationBatch": batch,
            "deployment": DEPLOYMENT,
        }
    )


def test_a_generation_request_has_the_templates_arn_and_spelt_out_counts():
    section = full().worldGeneration
    assert section is not None

    request = generation_request(section, section_parts(section)[0], template=TEMPLATE, token=TOKEN)

    assert (request.template, request.clientRequestToken) == (TEMPLATE, TOKEN)
    assert request.worldCount.interiorCountPerFloorplan == 1


def test_an_export_request_keeps_the_documents_token_and_names_a_role_without_effect():
    section = full().worldExport
    assert section is not None

    request = export_request(section, worlds=[WORLD], token=TOKEN)

    assert (request.clientRequestToken, request.iamRole, request.worlds) == ("mine", UNUSED_ROLE, (WORLD,))


def test_a_batch_request_has_arns_for_names_and_the_batchs_place_in_every_entry():
    section = full().simulationBatch
    assert section is not None

    (entry,) = batch_request(section, store_id="s1", token=TOKEN).createSimulationJobRequests

    assert entry.robotApplications is not None
    assert entry.robotApplications[0].application == "arn:simyard:robot-application:s1:courier"
    assert entry.outputLocation is not None
    assert entry.outputLocation.s3Bucket == "worlds"


def test_a_deployment_request_has_the_fleets_arn_and_the_given_version():
    section = full().deployment
    assert section is not None

    request = deployment_request(section, store_id="s1", version="3", token=TOKEN)

    assert request.fleet == "arn:simyard:deployment-fleet:s1:couriers"
    assert request.deploymentApplicationConfigs[0].applicationVersion == "3"


def test_an_arn_stays_as_it_stands():
    assert reference_arn("world", WORLD, "s1") == WORLD


@given(pipelines())
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_every_section_of_every_pipeline_stands_for_a_request(document: dict[str, object]):
    spec = PipelineSpec.model_validate(document)

    if spec.worldGeneration:
        (part,) = section_parts(spec.worldGeneration)
        assert generation_request(spec.worldGeneration, part, template=TEMPLATE, token=TOKEN).template == TEMPLATE
    if spec.worldExport:
        assert export_request(spec.worldExport, worlds=[WORLD], token=TOKEN).worlds == (WORLD,)
    if spec.simulationBatch:
        entries = batch_request(spec.simulationBatch, store_id="s1", token=TOKEN).createSimulationJobRequests
        assert len(entries) == len(spec.simulationBatch.createSimulationJobRequests)
    if spec.deployment:
        assert deployment_request(spec.deployment, store_id="s1", version="3", token=TOKEN).fleet.startswith("arn:")


def test_what_robomaker_has_no_words_for_is_left_out_of_its_requests():
    use = {**JOB["robotApplications"][0], "architecture": "ARM64"}
    named = {"untestedBuilds": {"ARM64": {"testedAs": "X86_64", "digest": "a" * 64}}, "untestedVariables": {"X": "why"}}
    spec = PipelineSpec.model_validate(
        {
            "name": "nightly",
            "worldGeneration": GENERATION,
            "simulationBatch": {"people": 4, "createSimulationJobRequests": [{**JOB, "robotApplications": [use]}]},
            "gate": {"successRate": {"atLeast": 0.9}},
            "deployment": {**DEPLOYMENT, **named},
        }
    )
    assert spec.simulationBatch
    assert spec.deployment
    (entry,) = batch_request(spec.simulationBatch, store_id="s1", token=TOKEN).createSimulationJobRequests
    assert entry.robotApplications
    assert "architecture" not in entry.robotApplications[0].model_dump()
    assert deployment_request(spec.deployment, store_id="s1", version="3", token=TOKEN).fleet
