"""What a document refers to, found before anything runs; all that is missing is told at once."""

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

from pydantic import JsonValue

from specs.base import Fault
from specs.bundle import ApplicationKind, Version
from specs.episode import ApplicationLaunch
from specs.errors import DocumentError, ObjectNotFound, ResourceNotFound
from specs.pipeline import ApplicationSource, PipelineSpec
from specs.pipeline_simulation import Deployment, SimulationBatch
from specs.template import template_digest
from tasks.applications.publishing import publish, resolve
from tasks.documents.templates import find_template
from tasks.simulate.batch_plan import BatchPlan
from tasks.simulate.resolving import plan_batch, worlds_named
from tasks.storage.keys import world_key
from tasks.storage.store import Store

Pins = dict[str, JsonValue]


def pins(spec: PipelineSpec, store: Store, base: Path) -> Pins:
    """Returns the digests of all that the document refers to, having published the bundles that come with it.

    Raises:
        DocumentError: Something is missing or contradicts itself; carries every fault.
    """
    faults: list[Fault] = []
    found: Pins = {}
    for source in spec.applications:
        _keep(faults, lambda source=source: found.update({source.name: published(source, store, base).digest}))
    if spec.worldGeneration:
        template = spec.worldGeneration.template
        _keep(faults, lambda: found.update(template=template_digest(find_template(template, store, base))))
    if spec.simulationBatch:
        batch = spec.simulationBatch
        _keep(faults, lambda: found.update(batch=_batch_pins(batch, store)))
    if spec.deployment:
        deployment = spec.deployment
        _keep(faults, lambda: found.update(deployment=_deployment_pin(deployment, spec.simulationBatch, store)))
    if faults:
        raise DocumentError(list(dict.fromkeys(faults)))
    return found


def published(source: ApplicationSource, store: Store, base: Path) -> Version:
    """Returns the version of a bundle that the document brings along.

    Raises:
        DocumentError: The folder is no bundle.
    """
    kind: ApplicationKind = "robot-application" if source.kind == "robot" else "simulation-application"
    return publish(store, kind, source.name, base / source.source)


def batch_plan(section: SimulationBatch, worlds: Sequence[str], store: Store) -> BatchPlan:
    """Returns the plan of a batch over the worlds that ``worlds: all`` means, and those that the section names.

    Raises:
        ResourceNotFound: A world or an application is missing.
        DocumentError: A request cannot be run.
    """
    named = worlds_named(section)
    matrix = list(worlds) if section.matrix.worlds == "all" else named
    digests = {reference: _world_digest(reference, store) for reference in dict.fromkeys([*matrix, *named])}
    return plan_batch(section, matrix, digests, lambda kind, name, version: resolve(store, kind, name, version))


def deployed_version(section: Deployment, store: Store) -> Version:
    """Returns the version that a deployment rolls out: the one it names, else the newest."""
    application = section.deploymentApplicationConfigs[0]
    return resolve(store, "robot-application", application.application, application.applicationVersion)


def _batch_pins(section: SimulationBatch, store: Store) -> Pins:
    plan = batch_plan(section, (), store)
    launches = [launch for template in plan.templates for launch in (template.robot, template.scenario)]
    return {**{launch.name: launch.digest for launch in launches}, **plan.world_digests}


def _deployment_pin(section: Deployment, batch: SimulationBatch | None, store: Store) -> str:
    version = deployed_version(section, store)
    tested = {launch.name: launch for launch in _robots(batch, store)}
    same = tested.get(version.name)
    if same and same.digest != version.digest:
        raise DocumentError(
            [
                Fault(
                    path="deployment.deploymentApplicationConfigs[0].applicationVersion",
                    value=f"{version.number} ({version.digest[:12]})",
                    allowed=f"the version that simulationBatch tests: {same.version} ({same.digest[:12]})",
                )
            ]
        )
    return version.digest


def _robots(batch: SimulationBatch | None, store: Store) -> list[ApplicationLaunch]:
    return [template.robot for template in batch_plan(batch, (), store).templates] if batch else []


def _world_digest(reference: str, store: Store) -> str:
    generation, _, name = reference.partition("/")
    try:
        body = store.get(world_key(generation, name)).body
    except ObjectNotFound as exc:
        fault = Fault(path="worlds", value=repr(reference), allowed=f"a world in {store.url}; see simyard list worlds")
        raise ResourceNotFound([fault]) from exc
    return hashlib.sha256(body).hexdigest()


def _keep(faults: list[Fault], look: Callable[[], None]) -> None:
    try:
        look()
    except DocumentError as exc:
        faults.extend(exc.faults)
