"""References of a document: looks all of them up before anything runs, and reports all faults at once.

What the document ships is held against what its batch drives. An output bucket that is a folder is made when it is
written: to refuse a new one would break the first steps, so `plan` and `run` name what is new, and what is there.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import TypeVar
from urllib.parse import unquote

from pydantic import JsonValue

from flows.pipeline.bundle_checks import check_planned_names, check_robot_files
from flows.pipeline.tested_batch import (
    batch_plan,
    candidates,
    compared_digest,
    launch_faults,
    require_one_version,
    tested_bundles,
    world_digests,
)
from flows.pipeline.version_retention import latest_version, publish_brought
from specs.arn import parse_reference, reference_path
from specs.base import Fault
from specs.errors import DocumentError, ObjectNotFound
from specs.pipeline.document import ApplicationSource, PipelineSpec
from specs.pipeline.gate_section import Gate
from specs.pipeline.section_requests import fleet_reference
from specs.pipeline.simulation_section import Deployment, LocalFleet, SimulationBatch
from specs.robomaker.bundle import LATEST, ApplicationKind, Version
from specs.template.body import template_digest
from tasks.applications.registry import find_by_digest, resolve
from tasks.deploy.rollout.resolved_request import preflight
from tasks.deploy.trust.trust_record import Signer, condition_fault, trust_faults
from tasks.documents.template_source import find_template
from tasks.export.format.formats import require_writable
from tasks.results.gate.shipped_builds import (
    Driven,
    Shipment,
    build_faults,
    differing_names,
    shipment_of,
    unjudged_lines,
    variable_faults,
)
from tasks.results.playback.replay_formats import require_bag_writers
from tasks.simulate.data.data_sources import DATA_PREFIX
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.plan_batch import FindVersion, output_location
from tasks.storage.base.store import Store
from tasks.storage.buckets import bucket_url, open_bucket, source_faults


def judged_shipment(section: Deployment, version: Version, plan: BatchPlan, driven: Collection[str]) -> Shipment:
    """Returns what a section ships under a gate.

    Args:
        section: The document's section.
        version: What it deploys.
        plan: The batch that the gate judges.
        driven: SHA-256 of each robot application that the batch tests.

    Raises:
        DocumentError: A build or a variable is not what the batch drives, and the section does not say so; or it says
            so without need.
    """
    ships = shipment_of(section, version)
    faults = [
        *build_faults(version, section.untestedBuilds or {}, driven),
        *variable_faults(_given(section), _driven(ships, plan, driven), section.untestedVariables or {}),
    ]
    if faults:
        raise DocumentError(faults)
    return ships


def unjudged_parts(section: Deployment, ships: Shipment, plan: BatchPlan) -> Iterator[str]:
    """Yields what a section ships without a gate, and what of it the document's batch does not drive, for a person.

    Args:
        section: The document's section.
        ships: What it ships.
        plan: The document's batch.
    """
    driven = {template.robot.digest for template in plan.templates}
    yield from unjudged_lines(ships, driven)
    for name in differing_names(_given(section), _driven(ships, plan, driven)):
        yield f"variable {name}: not as simulated, and no gate asks"


def _given(section: Deployment) -> Mapping[str, str]:
    return section.deploymentApplicationConfigs[0].launchConfig.environmentVariables or {}


def _driven(ships: Shipment, plan: BatchPlan, driven: Collection[str]) -> list[list[Driven]]:
    """Returns what the episodes of each build that ships had."""
    digests = dict.fromkeys([ships.digest, *ships.digests().values()])
    return [_had(plan, digest) for digest in digests if digest in driven]


def _had(plan: BatchPlan, digest: str) -> list[Driven]:
    """Returns the variables that the episodes of a bundle have; not the folders of their data, which robots lack."""
    own = [template.environment for template in plan.templates if template.robot.digest == digest]
    texts = [{name: value for name, value in each.items() if not value.startswith(DATA_PREFIX)} for each in own]
    return [{**{name: (value,) for name, value in each.items()}, **plan.sweep} for each in texts]


T = TypeVar("T")
Pins = dict[str, JsonValue]
Numbers = dict[str, str]
_SHIPS = "ships"
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
    _keep(faults, lambda: check_robot_files(spec, base))
    for source in spec.applications:
        _keep(faults, lambda source=source: own.update(_publish(source, store, base, spec)))
    find = finder(store, own)
    if spec.worldGeneration:
        template = spec.worldGeneration.template
        _keep(faults, lambda: found.update(template=template_digest(find_template(template, store, base))))
    if spec.worldExport:
        export = spec.worldExport
        open_bucket(store, export.outputLocation.s3Bucket or "")
        _keep(faults, lambda: require_writable(export.formats, "document", "worldExport.formats"))
        worlds = () if export.worlds == "all" else export.worlds
        _keep(faults, lambda: found.update(export={**world_digests(worlds, store)}))
    plan: BatchPlan | None = None
    if spec.simulationBatch:
        batch = spec.simulationBatch
        plan = _keep(faults, lambda: _checked_plan(batch, store, find))
        found |= {"batch": _batch_pins(plan)} if plan else {}
        _keep(faults, lambda: check_planned_names(spec.gate, plan, store) if plan else None)
        _keep(faults, lambda: found.update(_compared_pin(spec.gate, batch, find)))
        if spec.gate and plan:
            judged = plan
            _keep(faults, lambda: require_one_version(judged, str(found.get("comparedWith", ""))))
    if spec.deployment and not faults:
        deployment, other = spec.deployment, str(found.get("comparedWith", ""))
        tested = tested_bundles(plan, other) if plan else None
        version = _keep(faults, lambda: _deployable_version(deployment, tested, store, find))
        if version:
            ships = _keep(faults, lambda: _shipment(deployment, version, plan if spec.gate else None, other))
            found |= {"deployment": version.digest, **({_SHIPS: ships.model_dump(mode="json")} if ships else {})}
    if faults:
        raise DocumentError(list(dict.fromkeys(faults)))
    return found, own


def pinned_shipment(found: Pins) -> Shipment | None:
    """Returns what the document ships, of what `pins` found; None where it deploys nothing."""
    return Shipment.model_validate(found[_SHIPS]) if _SHIPS in found else None


def finder(store: Store, own: Mapping[str, Version]) -> FindVersion:
    """Returns a function that finds versions, each once; one that a document brings along stands for its own newest.

    Args:
        store: Where versions are.
        own: Versions of bundles that the document brings along, by ``<kind>/<name>``.
    """

    @cache  # a thousand requests use one application
    def find(kind: ApplicationKind, reference: str, version: str | None) -> Version:
        brought = own.get(_key(kind, reference_path(reference)))
        if brought and version in {None, LATEST}:
            return brought
        found = resolve(store, kind, reference, version)
        if faults := source_faults(store, found, "applicationVersion"):
            raise DocumentError(faults)
        return found

    return find


def latest_finder(store: Store) -> FindVersion:
    """Returns a finder for RoboMaker's calls, to which ``$LATEST``, or no version, is what lies at the sources now."""
    find = finder(store, {})

    @cache
    def find_latest(kind: ApplicationKind, reference: str, version: str | None) -> Version:
        return latest_version(store, kind, reference) if version in {None, LATEST} else find(kind, reference, version)

    return find_latest


def numbered_finder(store: Store, numbers: Numbers | None) -> FindVersion:
    """Returns a finder for a stage of its own, given the numbers of the applications that its document brought."""
    own: dict[str, Version] = {}
    for key, number in (numbers or {}).items():
        kind, _, name = key.partition("/")
        own[key] = resolve(store, _kind(kind), name, number)
    return finder(store, own)


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
        version = find_by_digest(store, "robot-application", use.application, tested[name])
    if tested and version.digest not in tested.values():
        path = "deployment.deploymentApplicationConfigs[0]"
        seen = ", ".join(f"{other} ({digest[:12]})" for other, digest in tested.items())
        value = f"{name} version {version.number} ({version.digest[:12]})"
        raise DocumentError.of(path, value, f"{_TESTED} {seen}")
    return version


def _publish(source: ApplicationSource, store: Store, base: Path, spec: PipelineSpec) -> dict[str, Version]:
    kind: ApplicationKind = "robot-application" if source.kind == "robot" else "simulation-application"
    return {_key(kind, source.name): publish_brought(store, kind, source.name, base / source.source, spec)}


def _checked_plan(section: SimulationBatch, store: Store, find: FindVersion) -> BatchPlan:
    """Returns the plan of a batch whose output bucket is there, and whose bundles have what is launched."""
    open_bucket(store, output_location(section).s3Bucket or "")
    require_bag_writers(section.recordings.bags)
    plan = batch_plan(section, (), store, find)
    if faults := launch_faults(plan, store):
        raise DocumentError(faults)
    return plan


def _batch_pins(plan: BatchPlan) -> Pins:
    data: Pins = {"data": [*plan.data_sources]} if plan.data_sources else {}
    return {"bundles": [*plan.digests()], "worlds": {**plan.world_digests}, **data}


def _compared_pin(gate: Gate | None, batch: SimulationBatch, find: FindVersion) -> Pins:
    digest = compared_digest(gate, batch, find)
    return {"comparedWith": digest} if digest else {}


def _shipment(section: Deployment, version: Version, plan: BatchPlan | None, other: str) -> Shipment:
    return judged_shipment(section, version, plan, candidates(plan, other)) if plan else shipment_of(section, version)


def _deployable_version(section: Deployment, tested: dict[str, str] | None, store: Store, find: FindVersion) -> Version:
    version = deployed_version(section, store, find, tested)
    fleet = section.fleet
    agents = fleet.localAgents if isinstance(fleet, LocalFleet) else 0
    launch = section.deploymentApplicationConfigs[0].launchConfig
    faults = trust_faults(trust=section.trust, local=agents > 0)
    signer = None if agents or faults else _signer(section, store)
    faults += _condition_faults(section, store)
    faults += preflight(
        store,
        fleet=fleet_reference(section),
        local_agents=agents,
        launch=launch,
        version=version,
        signer=signer,
    )
    if faults:
        raise DocumentError(faults)
    return version


def _condition_faults(section: Deployment, store: Store) -> list[Fault]:
    """Returns why the script that robots run before a download cannot be signed for; nothing where there is none."""
    condition = section.deploymentConfig.downloadConditionFile if section.deploymentConfig else None
    if condition is None or section.trust == "unsigned":
        return []
    path = "deployment.deploymentConfig.downloadConditionFile"
    try:
        etag = open_bucket(store, condition.bucket).get(condition.key).etag
    except ObjectNotFound:
        value = f"{condition.bucket}/{condition.key}"
        return [Fault(path=f"{path}.key", value=repr(value), allowed="an object of the bucket; there is none")]
    fault = condition_fault(condition, etag)
    return [fault.model_copy(update={"path": f"deployment.{fault.path}"})] if fault else []


def _signer(section: Deployment, store: Store) -> Signer | None:
    """Returns what shall sign a deployment to robots elsewhere, or None if nothing does."""
    from tasks.deploy.trust.signer import chosen_signer  # noqa: PLC0415 - only where keys are used

    return chosen_signer(store, section.trust, local=False)


def _key(kind: ApplicationKind, name: str) -> str:
    return f"{kind}/{name}"


def _kind(text: str) -> ApplicationKind:
    return "robot-application" if text == "robot-application" else "simulation-application"


def _keep(faults: list[Fault], look: Callable[[], T]) -> T | None:
    """Returns what was looked up; None where it is at fault, and the faults are kept."""
    try:
        return look()
    except DocumentError as exc:
        faults.extend(exc.faults)
        return None


_FOLDER = "file://"
_NAMED_AT_MOST = 10


def new_bucket_lines(spec: PipelineSpec, store: Store) -> Iterator[str]:
    """Yields a line for each output bucket of a document that is a folder which is not there yet."""
    places = [spec.worldExport.outputLocation] if spec.worldExport else []
    places += [output_location(spec.simulationBatch)] if spec.simulationBatch else []
    for name in dict.fromkeys(place.s3Bucket or "" for place in places):
        url = bucket_url(store, name)
        if url.startswith(_FOLDER) and not (folder := Path(unquote(url.removeprefix(_FOLDER)))).is_dir():
            yield f"bucket {name} is new, and is made in {folder}{_others(folder.parent)}"


def _others(home: Path) -> str:
    found = sorted(each.name for each in home.iterdir() if each.is_dir()) if home.is_dir() else []
    named = [each for each in found if not each.startswith(".")]
    more = ", ..." if len(named) > _NAMED_AT_MOST else ""
    return f"; there are {', '.join(named[:_NAMED_AT_MOST])}{more}" if named else ""
