"""`simyard plan`: what a run would do, without doing it."""

from collections.abc import Iterator
from pathlib import Path

from flows.resolving import finder, pins
from specs.episode import EpisodeRequest
from specs.pipeline import PipelineSpec, inert_fields
from specs.pipeline_requests import fleet_reference
from specs.pipeline_simulation import LocalFleet, SimulationBatch
from tasks.results.gate import episodes_needed
from tasks.simulate.layout import Layout
from tasks.simulate.preview import engine_plan
from tasks.simulate.resolving import FindVersion, matrix_worlds, plan_batch
from tasks.storage.overlay import OverlayStore
from tasks.storage.store import Store


def planned(spec: PipelineSpec, base: Path, store: Store) -> Iterator[str]:
    """Yields lines for a person: each stage, what it makes, and the fields that have no effect.

    Raises:
        DocumentError: The document refers to what does not exist; all of it at once.
    """
    trial = OverlayStore(store)  # bundles are published as a run would, and forgotten
    found, own = pins(spec, trial, base)
    yield f"{spec.name}, on {store.url}"
    worlds = 0
    if spec.worldGeneration:
        count = spec.worldGeneration.worldCount
        worlds = count.floorplanCount * count.interiorCountPerFloorplan
        product = f"{count.floorplanCount} floor plans x {count.interiorCountPerFloorplan} interiors"
        yield (
            f"worldGeneration   {worlds} worlds ({product}), seed {spec.worldGeneration.seed}, "
            f"for a robot of {spec.worldGeneration.robotRadius:g} m radius"
        )
    if spec.worldExport:
        place = spec.worldExport.outputLocation
        yield f"worldExport       {', '.join(spec.worldExport.formats)} to {place.s3Bucket}/{place.s3Prefix or ''}"
    episodes = 0
    if spec.simulationBatch:
        requests, lanes = _requests(spec.simulationBatch, worlds, finder(trial, own))
        episodes = len(requests)
        yield from _batch_lines(requests, lanes, spec.simulationBatch.engine)
    if spec.gate:
        yield from _gate_lines(spec, episodes)
    if spec.deployment:
        yield f"deployment        {_deployment(spec)}, bundle {str(found['deployment'])[:12]}"
    for field in inert_fields(spec):
        yield f"no effect         {field}"


def _requests(section: SimulationBatch, worlds: int, find: FindVersion) -> tuple[list[EpisodeRequest], int]:
    """Returns the episodes, over stand-ins for worlds that are not made yet, and the lanes of a chunk."""
    names = [f"planned/world-{number}" for number in range(worlds)]
    plan = plan_batch(section, matrix_worlds(section, names), {}, find)
    return list(Layout(plan).requests()), plan.lanes


def _batch_lines(requests: list[EpisodeRequest], lanes: int, engine: str) -> Iterator[str]:
    plan = engine_plan(requests, lanes)
    longest_s = max((request.duration_s for request in requests), default=0.0)
    yield f"simulationBatch   {len(requests)} episodes of at most {longest_s:g} simulated seconds"
    yield f"                  engine {engine} on {plan.devices} devices, {plan.compilations} compiled programs"
    steps = f"at most {plan.lane_steps_at_most:,} physics steps"
    yield f"                  {plan.chunks} chunks of {plan.lanes} lanes, {steps}"


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
