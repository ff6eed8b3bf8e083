"""Batches that ended and runs that judge them, without a simulator and without a Prefect server."""

from collections.abc import Mapping
from pathlib import Path

from flows.batch.batch_end import close_with_tables
from specs.data.episode import ApplicationLaunch
from specs.pipeline.document import PipelineSpec
from specs.robomaker.bundle import Version
from tasks.applications.registry import publish_bundle
from tasks.simulate.batch.batch_record import complete
from tasks.simulate.batch.chunk_run import Simulate, run_chunk
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, submit
from tests.factories.planned_batches import all_pass, begun, plan, template

JOB = {
    "maxJobDurationInSeconds": 60,
    "robotApplications": [{"application": "courier", "launchConfig": {}}],
    "simulationApplications": [{"application": "delivery", "launchConfig": {}}],
}
DEPLOYMENT = {
    "fleet": "couriers",
    "deploymentApplicationConfigs": [
        {"application": "courier", "launchConfig": {"packageName": "courier", "launchFile": "run.sh"}}
    ],
}


def document(gate: Mapping[str, object]) -> PipelineSpec:
    """Returns a document that tests courier, and deploys it if the gate passes."""
    batch = {"matrix": {"worlds": ["g/w0", "g/w1"]}, "createSimulationJobRequests": [JOB]}
    return PipelineSpec.model_validate(
        {"name": "nightly", "simulationBatch": batch, "gate": gate, "deployment": DEPLOYMENT}
    )


def courier(store: Store, folder: Path, text: str) -> ApplicationLaunch:
    """Returns a published version of courier with that text in it."""
    return _launch("courier", _published(store, folder, "courier", text), "go_to_goal")


def delivery(store: Store, folder: Path, text: str = "rooms") -> ApplicationLaunch:
    """Returns the published scenario."""
    return _launch("delivery", _published(store, folder, "delivery", text), "rooms")


def ended(
    store: Store,
    *robots: ApplicationLaunch,
    scenario: ApplicationLaunch,
    simulate: Simulate = all_pass,
    name: str = "tok",
    **changes: object,
) -> JobRecord:
    """Returns a batch of 80 episodes for each of the robots, all its tables written."""
    templates = tuple(template(robot=robot, scenario=scenario) for robot in robots)
    wanted = {"templates": templates, "seeds": tuple(range(40)), "lanes": 40, **changes}
    batch = begun(store, plan(store, **wanted), name)
    for number in range(batch.layout.chunks):
        run_chunk(batch, number, simulate, lanes=batch.plan.lanes, left_s=3600.0)
    complete(batch)
    return close_with_tables(batch)


def run_of(store: Store, name: str = "run") -> JobRecord:
    """Returns a pipeline's run that is under way."""
    run = submit(store, "pipeline-run", {"name": name}, name)
    return advance(store, "pipeline-run", run.id, "Running")


def _published(store: Store, folder: Path, name: str, text: str) -> Version:
    package = folder / f"{name}-{text}" / name
    package.mkdir(parents=True, exist_ok=True)
    (package / "run.sh").write_text(f"#!/bin/sh\n# {text}\n")
    kind = "robot-application" if name == "courier" else "simulation-application"
    return publish_bundle(store, kind, name, package.parent)


def _launch(name: str, version: Version, launch_file: str) -> ApplicationLaunch:
    return ApplicationLaunch(
        name=name, version=str(version.number), digest=version.digest, package=name, launch_file=launch_file
    )
