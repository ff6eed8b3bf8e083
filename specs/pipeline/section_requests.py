"""The sections of a pipeline as the RoboMaker requests that they stand for.

A pipeline may say less than RoboMaker's requests must: names instead of ARNs, no role, no token. What is missing is
filled in here, so that a job's record holds a request that RoboMaker would have understood.
"""

from collections.abc import Iterator, Sequence

from pydantic import JsonValue

from specs.arn import ResourceKind, arn
from specs.base import Fault, Spec, canonical_document
from specs.pipeline.generation_parts import GenerationPart, generation_parts
from specs.pipeline.simulation_section import (
    Deployment,
    LocalFleet,
    PipelineJobRequest,
    PipelineSimulationApplication,
    SimulationBatch,
    runs_nodes,
)
from specs.pipeline.world_sections import WorldExport, WorldGeneration
from specs.robomaker.deployment import CreateDeploymentJobRequest
from specs.robomaker.simulation import CreateSimulationJobRequest, SimulationJobRequest, StartSimulationJobBatchRequest
from specs.robomaker.world_jobs import CreateWorldExportJobRequest, CreateWorldGenerationJobRequest
from specs.rules import items, part

UNUSED_ROLE = "arn:aws:iam::000000000000:role/simyard-needs-none"
"""Stands where RoboMaker's request must name a role and the document does not; it has no effect."""


def reference_arn(kind: ResourceKind, reference: str, store_id: str) -> str:
    """Returns a reference as an ARN: ARNs as they stand, plain names as resources of the store with that id."""
    return reference if reference.startswith("arn:") else arn(kind, store_id, reference)


def fleet_reference(section: Deployment) -> str:
    """Returns the name or ARN of the fleet that a deployment goes to."""
    return section.fleet.name if isinstance(section.fleet, LocalFleet) else section.fleet


def section_parts(section: WorldGeneration, most: int | None = None) -> tuple[GenerationPart, ...]:
    """Returns the generation jobs that a section asks for.

    Args:
        section: The section of the pipeline.
        most: Worlds of one job; what this machine allows, if left out.
    """
    count = section.worldCount
    return generation_parts(count.floorplanCount, count.interiorCountPerFloorplan, most)


def generation_request(
    section: WorldGeneration, part: GenerationPart, *, template: str, token: str
) -> CreateWorldGenerationJobRequest:
    """Returns the request for a generation job.

    Args:
        section: The section of the pipeline.
        part: The worlds that this job makes.
        template: ARN of the template, which the section may give as a path or a body.
        token: Used where the section has no token of its own.
    """
    document = _without(section, "seed", "template", "robotRadius")
    count = {"floorplanCount": part.floorplans, "interiorCountPerFloorplan": part.interiors}
    token = part.token(section.clientRequestToken or token)
    return CreateWorldGenerationJobRequest.model_validate(
        {**document, "clientRequestToken": token, "template": template, "worldCount": count}
    )


def export_request(section: WorldExport, *, worlds: Sequence[str], token: str) -> CreateWorldExportJobRequest:
    """Returns the request for an export job.

    Args:
        section: The section of the pipeline.
        worlds: ARNs of the worlds, 1 to 100.
        token: Used where the section has no token of its own.
    """
    document = _without(section, "formats", "worlds")
    return CreateWorldExportJobRequest.model_validate(
        {"clientRequestToken": token, "iamRole": UNUSED_ROLE, **document, "worlds": list(worlds)}
    )


def batch_request(section: SimulationBatch, *, store_id: str, token: str) -> StartSimulationJobBatchRequest:
    """Returns the request for a batch, before the matrix multiplies it; names become ARNs of the store.

    Args:
        section: The section of the pipeline.
        store_id: Id of the store that plain names belong to.
        token: Used where the section has no token of its own.
    """
    own = SimulationBatch.model_fields.keys() - StartSimulationJobBatchRequest.model_fields.keys()
    document = _without(section, *own, "createSimulationJobRequests")
    jobs = [job_request(request, section, store_id=store_id) for request in section.createSimulationJobRequests]
    return StartSimulationJobBatchRequest.model_validate(
        {"clientRequestToken": token, **document, "createSimulationJobRequests": jobs}
    )


def simulation_request(
    section: SimulationBatch, *, store_id: str, token: str
) -> StartSimulationJobBatchRequest | CreateSimulationJobRequest:
    """Returns the request that a section stands for: one for a batch, or for a single job.

    Args:
        section: The section of the pipeline.
        store_id: Id of the store that plain names belong to.
        token: Used where the section has no token of its own.
    """
    if section.operation == "StartSimulationJobBatch":
        return batch_request(section, store_id=store_id, token=token)
    (request,) = section.createSimulationJobRequests
    document = {
        "clientRequestToken": section.clientRequestToken or token,
        "iamRole": UNUSED_ROLE,
        **_job_document(request, section, store_id),
    }
    document.pop("useDefaultApplications", None)  # which only entries of a batch have
    return CreateSimulationJobRequest.model_validate(document)


def job_request(request: PipelineJobRequest, section: SimulationBatch, *, store_id: str) -> SimulationJobRequest:
    """Returns one entry of a batch with ARNs for names, and the batch's output location where it has none."""
    return SimulationJobRequest.model_validate(_job_document(request, section, store_id))


def _job_document(request: PipelineJobRequest, section: SimulationBatch, store_id: str) -> dict[str, JsonValue]:
    document = _without(request, "robotApplications", "simulationApplications", "seed", "physics")
    if section.outputLocation is not None:
        document = {"outputLocation": canonical_document(section.outputLocation), **document}
    robots: list[JsonValue] = [
        {**_without(use, "architecture"), "application": reference_arn("robot-application", use.application, store_id)}
        for use in request.robotApplications or ()
    ]
    scenarios: list[JsonValue] = [_scenario(use, store_id) for use in request.simulationApplications or ()]
    return {**document, "robotApplications": robots or None, "simulationApplications": scenarios or None}


def deployment_request(section: Deployment, *, store_id: str, version: str, token: str) -> CreateDeploymentJobRequest:
    """Returns the request for a deployment job; names become ARNs of the store.

    Args:
        section: The section of the pipeline.
        store_id: Id of the store that plain names belong to.
        version: Number of the version that is deployed where the section does not say.
        token: Used where the section has no token of its own.
    """
    beyond = ("fleet", "rollOut", "trust", "untestedBuilds", "untestedVariables", "deploymentApplicationConfigs")
    document = _without(section, *beyond)
    applications = [
        {
            "applicationVersion": version,
            **canonical_document(use),
            "application": reference_arn("robot-application", use.application, store_id),
        }
        for use in section.deploymentApplicationConfigs
    ]
    fleet = reference_arn("deployment-fleet", fleet_reference(section), store_id)
    return CreateDeploymentJobRequest.model_validate(
        {"clientRequestToken": token, **document, "fleet": fleet, "deploymentApplicationConfigs": applications}
    )


def _scenario(use: PipelineSimulationApplication, store_id: str) -> dict[str, JsonValue]:
    application = reference_arn("simulation-application", use.application, store_id)
    document = {**canonical_document(use), "application": application}
    worlds = [config.world for config in use.worldConfigs or () if config.world is not None]
    if worlds:
        document["worldConfigs"] = [{"world": reference_arn("world", world, store_id)} for world in worlds]
    return document


def _without(section: Spec, *names: str) -> dict[str, JsonValue]:
    return {key: value for key, value in canonical_document(section).items() if key not in names}


REQUESTS = "simulationBatch.createSimulationJobRequests"
_BOTH = "one: an episode needs a robot and a scenario; a simulation application alone must be a launch file of ROS"
_OTHER = "; of a container image a command will do"


def undriven_faults(section: object) -> list[Fault]:
    """Returns a fault for each application that a request lacks, and for what its launch configuration does not say.

    RoboMaker took a request without one of them, and a launch configuration with a command instead
    (docs/reference/robomaker.md, sections 3 and 10). A simulation application of ROS may be alone.

    Args:
        section: The batch, a SimulationBatch or what a document has in its place.
    """
    requests = enumerate(items(part(section, "createSimulationJobRequests")))
    return [fault for number, request in requests for fault in _faults(f"{REQUESTS}[{number}]", request)]


def _faults(where: str, request: object) -> Iterator[Fault]:
    judge = next(iter(items(part(request, "simulationApplications"))), None)
    alone = runs_nodes(part(judge, "launchConfig"))
    for field in ("robotApplications", "simulationApplications"):
        uses = items(part(request, field))
        if not uses:
            if field != "robotApplications" or not alone:
                yield Fault(path=f"{where}.{field}", value="none", allowed=_BOTH)
            continue
        launch = part(uses[0], "launchConfig")
        if part(launch, "command") and not part(launch, "launchFile"):  # of a container image
            continue
        for name, what in (("packageName", "folder in the bundle"), ("launchFile", "module in that folder")):
            if not part(launch, name):
                path = f"{where}.{field}[0].launchConfig.{name}"
                yield Fault(path=path, value="none", allowed=f"the {what} to launch{_OTHER}")
