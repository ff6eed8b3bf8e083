"""`simyard plan`: what a run would do, without doing it."""

from collections.abc import Iterator
from pathlib import Path

from tasks.simulate.preview import chosen_engine

from flows.resolving import pins
from specs.pipeline import PipelineSpec, inert_fields
from specs.pipeline_requests import fleet_reference
from specs.pipeline_simulation import LocalFleet, PipelineJobRequest, SimulationBatch
from tasks.results.gate import episodes_needed
from tasks.simulate.batch_plan import lane_count
from tasks.simulate.resolving import seed_list
from tasks.storage.store import Store


def planned(spec: PipelineSpec, base: Path, store: Store) -> Iterator[str]:
    """Yields lines for a person: each stage, what it makes, and the fields that have no effect.

    Raises:
        DocumentError: The document refers to what does not exist; all of it at once.
    """
    found = pins(spec, store, base)
    yield f"{spec.name}, on {store.url}"
    worlds = 0
    if spec.worldGeneration:
        count = spec.worldGeneration.worldCount
        worlds = count.floorplanCount * count.interiorCountPerFloorplan
        product = f"{count.floorplanCount} floor plans x {count.interiorCountPerFloorplan} interiors"
        yield f"worldGeneration   {worlds} worlds ({product}), seed {spec.worldGeneration.seed}"
    if spec.worldExport:
        place = spec.worldExport.outputLocation
        yield f"worldExport       {', '.join(spec.worldExport.formats)} to {place.s3Bucket}/{place.s3Prefix or ''}"
    episodes = 0
    if spec.simulationBatch:
        episodes = _episodes(spec.simulationBatch, worlds)
        yield from _batch_lines(spec.simulationBatch, episodes)
    if spec.gate:
        yield from _gate_lines(spec, episodes)
    if spec.deployment:
        yield f"deployment        {_deployment(spec)}, bundle {str(found['deployment'])[:12]}"
    for field in inert_fields(spec):
        yield f"no effect         {field}"


def _episodes(section: SimulationBatch, worlds: int) -> int:
    matrix = section.matrix
    per_world = len(seed_list(section))
    for values in matrix.environmentVariables.values():
        per_world *= len(values)
    in_matrix = worlds if matrix.worlds == "all" else len(matrix.worlds)
    return per_world * sum(_worlds_of(request, in_matrix) for request in section.createSimulationJobRequests)


def _worlds_of(request: PipelineJobRequest, in_matrix: int) -> int:
    own = sum(len(scenario.worldConfigs or ()) for scenario in request.simulationApplications or ())
    return own or in_matrix


def _batch_lines(section: SimulationBatch, episodes: int) -> Iterator[str]:
    policy = section.batchPolicy
    lanes = lane_count(policy and policy.maxConcurrency, episodes)
    longest_s = max(request.maxJobDurationInSeconds for request in section.createSimulationJobRequests)
    yield f"simulationBatch   {episodes} episodes of at most {longest_s} simulated seconds"
    chunks = -(-episodes // lanes)
    yield f"                  engine {chosen_engine(section.engine)}, {lanes} lanes, about {chunks} chunks"


def _gate_lines(spec: PipelineSpec, episodes: int) -> Iterator[str]:
    rule = spec.gate.successRate if spec.gate else None
    if rule is None:
        return
    yield f"gate              at least {100 * rule.atLeast:g} % pass, {100 * rule.confidence:g} % confidence"
    for rate in (1.0, 0.98, 0.95):
        needed = episodes_needed(rule.atLeast, rule.confidence, rate)
        if needed is not None:
            enough = "enough" if episodes >= needed else "NOT ENOUGH"
            yield f"                  if {100 * rate:g} % pass, {needed} are needed: {episodes} are {enough}"


def _deployment(spec: PipelineSpec) -> str:
    section = spec.deployment
    if section is None:
        return ""
    fleet = section.fleet
    robots = f" with {fleet.localAgents} agents on this machine" if isinstance(fleet, LocalFleet) else ""
    application = section.deploymentApplicationConfigs[0]
    version = application.applicationVersion or "tested"
    return f"{application.application} (version {version}) to fleet {fleet_reference(section)}{robots}"
