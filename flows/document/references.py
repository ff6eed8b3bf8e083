"""What a document refers to, found before anything runs; all that is missing is told at once."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path

from pydantic import JsonValue

from flows.document.tested_version import candidates, compared_digest
from specs.arn import parse_reference
from specs.base import Fault
from specs.data.episode import ApplicationLaunch
from specs.errors import DocumentError, ObjectNotFound, ResourceNotFound
from specs.pipeline.document import ApplicationSource, PipelineSpec
from specs.pipeline.gate_section import Gate
from specs.pipeline.section_requests import fleet_reference
from specs.pipeline.simulation_section import Deployment, LocalFleet, SimulationBatch
from specs.robomaker.bundle import LATEST, ApplicationKind, Version
from specs.robomaker.simulation import DataSourceConfig
from specs.template.body import template_digest
from tasks.applications.registry import publish, resolve, with_digest
from tasks.deploy.rollout.resolved_request import preflight
from tasks.deploy.trust.trust_choice import trust_faults
from tasks.documents.template_source import find_template
from tasks.export.format.availability import require_writable
from tasks.simulate.data.pins import pinned
from tasks.simulate.data.sources import PinnedSource
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.resolve import FindVersion, matrix_worlds, output_location, plan_batch, requested_worlds
from tasks.storage.archives import missing_files
from tasks.storage.base.cache_folder import cache_folder
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import changed_sources, open_bucket

Pins = dict[str, JsonValue]
Numbers = dict[str, str]
_TESTED = "the bundle that simulationBatch tests; leave applicationVersion out to deploy it:"


def pins(spec: PipelineSpec, store: Store, base: Path) -> tuple[Pins, dict[str, Version]]:
    """Returns the digests of all that the document refers to, and the versions of the bundles that it brings along.

    Args:
        spec: The document.
        store: Where references lead.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: Something is missing or contradicts itself; carries every fault.
        StoreUnreachable: An output bucket does not exist.
    """
    faults: list[Fault] = []
    found: Pins = {}
    own: dict[str, Version] = {}
    for source in spec.applications:
        _keep(faults, lambda source=source: own.update(_published(source, store, base)))
    find = finder(store, own)
    if spec.worldGeneration:
        template = spec.worldGeneration.template
        _keep(faults, lambda: found.update(template=template_digest(find_template(template, store, base))))
    if spec.worldExport:
        export = spec.worldExport
        open_bucket(store, export.outputLocation.s3Bucket or "")
        _keep(faults, lambda: require_writable(export.formats, "document", "worldExport.formats"))
        _keep(faults, lambda: found.update(export={**_digests(() if export.worlds == "all" else export.worlds, store)}))
    if spec.simulationBatch:
        batch = spec.simulationBatch
        _keep(faults, lambda: found.update(batch=_batch_pins(batch, store, find)))
        _keep(faults, lambda: found.update(_compared_pin(spec.gate, batch, find)))
    if spec.deployment and not faults:
        deployment = spec.deployment
        other = str(found.get("comparedWith", ""))
        _keep(
            faults,
            lambda: found.update(deployment=_deployment_pin(deployment, spec.simulationBatch, other, store, find)),
        )
    if faults:
        raise DocumentError(list(dict.fromkeys(faults)))
    return found, own


def finder(store: Store, own: Mapping[str, Version]) -> FindVersion:
    """Returns a function that finds versions, each once; one that a document brings along stands for its own newest.

    Args:
        store: Where versions are.
        own: Versions of bundles that the document brings along, by ``<kind>/<name>``.
    """

    @cache  # a thousand requests use one application
    def find(kind: ApplicationKind, reference: str, version: str | None) -> Version:
        brought = own.get(_key(kind, _path(reference)))
        if brought and version in {None, LATEST}:
            return brought
        found = resolve(store, kind, reference, version)
        if faults := changed_sources(store, found, "applicationVersion"):
            raise DocumentError(faults)
        return found

    return find


def numbered_finder(store: Store, numbers: Numbers | None) -> FindVersion:
    """Returns a finder for a stage of its own, given the numbers of the applications that its document brought."""
    own: dict[str, Version] = {}
    for key, number in (numbers or {}).items():
        kind, _, name = key.partition("/")
        own[key] = resolve(store, _kind(kind), name, number)
    return finder(store, own)


def batch_plan(section: SimulationBatch, worlds: Sequence[str], store: Store, find: FindVersion) -> BatchPlan:
    """Returns the plan of a batch over the worlds that ``worlds: all`` means, and those that the section names.

    Raises:
        ResourceNotFound: A world or an application is missing.
        DocumentError: A request cannot be run.
    """
    matrix = matrix_worlds(section, worlds)

    @cache
    def look(source: str) -> PinnedSource:
        return pinned(store, cache_folder() / "data", DataSourceConfig.model_validate_json(source))

    return plan_batch(
        section,
        matrix,
        _digests([*matrix, *requested_worlds(section)], store),
        find,
        lambda source: look(source.model_dump_json()),
    )


def _path(reference: str) -> str:
    """Returns what a reference names; one that is malformed stands for itself, and is refused where it is resolved."""
    try:
        return parse_reference(reference).path
    except ValueError:
        return reference


def failing_sources(section: SimulationBatch, store: Store, find: FindVersion) -> list[str]:
    """Returns which data sources of a batch cannot be used, and why: the jobs that need them will fail."""
    sources = batch_plan(section, (), store, find).data_sources.values()
    return [f"{source.failure_code}: {source.failure_reason}" for source in sources if source.failure_code]


def deployed_version(section: Deployment, store: Store, find: FindVersion, tested: Mapping[str, str] | None) -> Version:
    """Returns the version that a deployment rolls out: the one it names, else the tested one, else the newest.

    Args:
        section: The document's section.
        store: Where versions are.
        find: Finds versions.
        tested: Digests of the robot applications that a batch tested, by name; only they may be rolled out then.

    Raises:
        ResourceNotFound: There is no such version.
        DocumentError: It is not what was tested.
    """
    use = section.deploymentApplicationConfigs[0]
    name = parse_reference(use.application).path
    version = find("robot-application", use.application, use.applicationVersion)
    if use.applicationVersion is None and tested and tested.get(name, version.digest) != version.digest:
        version = with_digest(store, "robot-application", use.application, tested[name])
    if tested and version.digest not in tested.values():
        path = "deployment.deploymentApplicationConfigs[0]"
        seen = ", ".join(f"{other} ({digest[:12]})" for other, digest in tested.items())
        value = f"{name} version {version.number} ({version.digest[:12]})"
        raise DocumentError([Fault(path=path, value=value, allowed=f"{_TESTED} {seen}")])
    return version


def tested_bundles(plan: BatchPlan, other: str) -> dict[str, str]:
    """Returns the digest of each robot application that a batch tests, by name, but for what it is compared with."""
    launches: list[ApplicationLaunch] = [template.robot for template in plan.templates]
    meant = candidates(plan, other)
    return {launch.name: launch.digest for launch in launches if launch.digest in meant}


def _published(source: ApplicationSource, store: Store, base: Path) -> dict[str, Version]:
    kind: ApplicationKind = "robot-application" if source.kind == "robot" else "simulation-application"
    return {_key(kind, source.name): publish(store, kind, source.name, base / source.source)}


def _batch_pins(section: SimulationBatch, store: Store, find: FindVersion) -> Pins:
    open_bucket(store, output_location(section).s3Bucket or "")
    plan = batch_plan(section, (), store, find)
    if faults := _launch_faults(plan, store):
        raise DocumentError(faults)
    data: Pins = {"data": [*plan.data_sources]} if plan.data_sources else {}
    return {"bundles": [*plan.digests()], "worlds": {**plan.world_digests}, **data}


def _compared_pin(gate: Gate | None, batch: SimulationBatch, find: FindVersion) -> Pins:
    digest = compared_digest(gate, batch, find)
    return {"comparedWith": digest} if digest else {}


def _deployment_pin(
    section: Deployment, batch: SimulationBatch | None, other: str, store: Store, find: FindVersion
) -> str:
    tested = tested_bundles(batch_plan(batch, (), store, find), other) if batch else None
    version = deployed_version(section, store, find, tested)
    fleet = section.fleet
    agents = fleet.localAgents if isinstance(fleet, LocalFleet) else 0
    launch = section.deploymentApplicationConfigs[0].launchConfig
    faults = trust_faults(trust=section.trust, local=agents > 0)
    faults += preflight(store, fleet=fleet_reference(section), local_agents=agents, launch=launch, version=version)
    if faults:
        raise DocumentError(faults)
    return version.digest


def _launch_faults(plan: BatchPlan, store: Store) -> list[Fault]:
    """Returns a fault for each launch file that is not in its bundle, told once however many requests launch it."""
    launches = dict.fromkeys(launch for each in plan.templates for launch in (each.robot, each.scenario))
    return [
        Fault(
            path="simulationBatch.createSimulationJobRequests[*].launchConfig.launchFile",
            value=repr(launch.launch_file),
            allowed=f"a module in {launch.name}'s bundle; it has no {missing}",
        )
        for launch in launches
        for missing in missing_files(store, launch.digest, [f"{launch.package}/{launch.launch_file}.py"])
    ]


def _digests(references: Sequence[str], store: Store) -> dict[str, str]:
    """Returns the SHA-256 of each world's document, by ``<generation>/<world>``."""
    paths = dict.fromkeys(parse_reference(reference).path for reference in references)
    return {path: _world_digest(path, store) for path in paths}


def _world_digest(path: str, store: Store) -> str:
    generation, _, name = path.partition("/")
    try:
        body = store.get(world_key(generation, name)).body
    except ObjectNotFound as exc:
        fault = Fault(path="worlds", value=repr(path), allowed=f"a world in {store.url}; see simyard list worlds")
        raise ResourceNotFound([fault]) from exc
    return hashlib.sha256(body).hexdigest()


def _key(kind: ApplicationKind, name: str) -> str:
    return f"{kind}/{name}"


def _kind(text: str) -> ApplicationKind:
    return "robot-application" if text == "robot-application" else "simulation-application"


def _keep(faults: list[Fault], look: Callable[[], None]) -> None:
    try:
        look()
    except DocumentError as exc:
        faults.extend(exc.faults)
