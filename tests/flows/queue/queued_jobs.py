"""Jobs as the gateway records and queues them (the contract is in flows.queue.queued_flows)."""

from collections.abc import Sequence
from typing import cast

import yaml
from pydantic import JsonValue

from flows.pipeline.references import numbered_finder
from flows.pipeline.tested_batch import batch_plan
from specs.arn import arn
from specs.base import canonical_document, canonical_json
from specs.job_kinds import JobKind
from specs.pipeline.section_requests import simulation_request
from specs.pipeline.simulation_section import SimulationBatch
from specs.robomaker.deployment import CreateDeploymentJobRequest
from specs.robomaker.world_jobs import CreateWorldExportJobRequest, CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody, template_digest
from tasks.applications.registry import resolve
from tasks.storage.base.keys import template_key
from tasks.storage.base.store import Store, create_once
from tasks.storage.jobs.queue import enqueue
from tasks.storage.jobs.records import JobRecord, job_id, submit
from tasks.storage.store_url import store_id
from tasks.worlds.job.generation_job import run_generation_job
from tests.repository import ROOT

TEMPLATE = TemplateBody.model_validate_json((ROOT / "examples/templates/two-rooms.json").read_bytes())


def queue_job(
    store: Store, kind: JobKind, request: dict[str, JsonValue], token: str, options: dict[str, JsonValue] | None = None
) -> JobRecord:
    """Returns the record of a job, which waits for a worker."""
    enqueue(store, kind, job_id(kind, token), options)
    return submit(store, kind, request, token)


def generation_request(store: Store, token: str, floorplans: int = 1) -> CreateWorldGenerationJobRequest:
    """Returns a request for worlds of two rooms."""
    return CreateWorldGenerationJobRequest.model_validate(
        {
            "clientRequestToken": token,
            "template": arn("world-template", store_id(store), template_digest(TEMPLATE)),
            "worldCount": {"floorplanCount": floorplans, "interiorCountPerFloorplan": 1},
        }
    )


def queue_generation(store: Store, token: str, floorplans: int = 1) -> JobRecord:
    """Returns the record of a generation job, which waits for a worker."""
    digest = template_digest(TEMPLATE)
    create_once(store, template_key(digest), canonical_json(canonical_document(TEMPLATE)))
    own: dict[str, JsonValue] = {"seed": 7, "templateDigest": digest}
    asked = canonical_document(generation_request(store, token, floorplans))
    return queue_job(store, "world-generation-job", {**asked, **own}, token)


def queue_export(store: Store, worlds: Sequence[str], token: str, bucket: str = "worlds") -> JobRecord:
    """Returns the record of an export job, which waits for a worker."""
    request = CreateWorldExportJobRequest.model_validate(
        {
            "clientRequestToken": token,
            "worlds": [arn("world", store_id(store), world) for world in worlds],
            "outputLocation": {"s3Bucket": bucket, "s3Prefix": "export"},
            "iamRole": "arn:aws:iam::000000000000:role/none",
        }
    )
    return queue_job(store, "world-export-job", {**canonical_document(request), "formats": ["sdf", "svg"]}, token)


def some_worlds(store: Store, floorplans: int = 1) -> list[str]:
    """Returns worlds of the store, made at the first call."""
    token = "worlds"  # noqa: S105 - a request's, no secret
    request = generation_request(store, token, floorplans)
    made = run_generation_job(store, request, TEMPLATE, seed=7, token=token, progress=lambda _done, _total: None)
    return cast("list[str]", made.detail["worlds"])


def queue_batch(store: Store, worlds: Sequence[str], token: str, seeds: int = 4, lanes: int = 4) -> JobRecord:
    """Returns the record of a batch, a chunk for each so many lanes, which waits for a worker."""
    section = yaml.safe_load((ROOT / "examples/quickstart.yaml").read_text())["simulationBatch"]
    section["batchPolicy"]["maxConcurrency"] = lanes
    section["audit"] = {"lanes": 0}
    section["matrix"] = {"worlds": list(worlds), "seeds": seeds}
    spec = SimulationBatch.model_validate(section)
    plan = batch_plan(spec, [], store, numbered_finder(store, None))
    request = simulation_request(spec, store_id=store_id(store), token=token)
    document: dict[str, JsonValue] = {"request": canonical_document(request), "plan": plan.model_dump(mode="json")}
    return queue_job(store, "simulation-job-batch", document, token)


def deployment_request(store: Store, fleet: str, token: str) -> CreateDeploymentJobRequest:
    """Returns a request to deploy the courier, by its version's number."""
    version = resolve(store, "robot-application", "courier")
    return CreateDeploymentJobRequest.model_validate(
        {
            "clientRequestToken": token,
            "fleet": arn("deployment-fleet", store_id(store), fleet),
            "deploymentApplicationConfigs": [
                {
                    "application": arn("robot-application", store_id(store), "courier"),
                    "applicationVersion": str(version.number),
                    "launchConfig": {"packageName": "courier", "launchFile": "run.sh"},
                }
            ],
        }
    )
