"""References of a document: looks all of them up before anything runs, and reports all faults at once.

What the document ships is held against what its batch drives. An output bucket that is a folder is made when it is
written: to refuse a new one would break the first steps, so `plan` and `run` name what is new, and what is there.
"""

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from urllib.parse import unquote

from pydantic import JsonValue

from flows.pipeline.bundle_checks import (
    check_modules,
    check_planned_confinement,
    check_planned_names,
    check_robot_files,
)
from flows.pipeline.robot_drafts import with_drafts
from flows.pipeline.tested_batch import (
    batch_plan,
    candidates,
    compared_digest,
    launch_faults,
    other_digest,
    require_one_version,
    tested_bundles,
    world_digests,
    worldless_fault,
)
from flows.pipeline.version_retention import latest_version, publish_brought
from flows.pipeline.world_imports import ImportedWorld, import_worlds, keep_world
from specs.arn import parse_reference, reference_path
from specs.base import Fault
from specs.errors import BucketNotFound, DocumentError, KeptFaults, ObjectNotFound
from specs.field_types import OutputLocation
from specs.pipeline.document import ApplicationSource, PipelineSpec, place_worlds
from specs.pipeline.section_requests import fleet_reference
from specs.pipeline.simulation_section import Deployment, LocalFleet, SimulationBatch
from specs.pipeline.world_sections import WorldImport
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
from tasks.simulate.sandbox.process_environment import require_environment
from tasks.storage.base.store import Store
from tasks.storage.buckets import bucket_url, open_bucket, source_faults
from tasks.storage.jobs.records import JobRecord


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


Pins = dict[str, JsonValue]
Numbers = dict[str, str]
_TESTED = "the bundle that simulationBatch tests; leave applicationVersion out to deploy it:"


@dataclass(frozen=True)
class Resolved:
    """What a document refers to, looked up once, before anything runs.

    Attributes:
        bundled: Versions of the bundles that the document brings along, by ``<kind>/<name>``.
        imported: The worlds that the document imports, in its order.
        template: SHA-256 of the template; empty if the document makes no worlds.
        exported: SHA-256 of each world that the export names; None if there is no export.
        batch: The batch over the worlds that it names; None if there is none.
        compared_with: SHA-256 of the bundle that the gate compares with; empty if it compares with none.
        deployed: The version that is rolled out; None if nothing is.
        ships: What robots get, build by build; None likewise.
    """

    bundled: Mapping[str, Version] = field(default_factory=dict[str, Version])
    imported: Sequence[ImportedWorld] = ()
    template: str = ""
    exported: Mapping[str, str] | None = None
    batch: BatchPlan | None = None
    compared_with: str = ""
    deployed: Version | None = None
    ships: Shipment | None = None

    def pins(self) -> Pins:
        """Returns all of it by its digests, which tell a run of the document from one of other things."""
        found: Pins = {}
        if self.imported:
            found["worlds"] = {**self.imported_digests()}
        if self.template:
            found["template"] = self.template
        if self.exported is not None:
            found["export"] = {**self.exported}
        if self.batch:
            data: Pins = {"data": [*self.batch.data_sources]} if self.batch.data_sources else {}
            found["batch"] = {"bundles": [*self.batch.digests()], "worlds": {**self.batch.world_digests}, **data}
        if self.compared_with:
            found["comparedWith"] = self.compared_with
        if self.deployed:
            found["deployment"] = self.deployed.digest
        if self.ships:
            found["ships"] = self.ships.model_dump(mode="json")
        return found

    def numbers(self) -> Numbers:
        """Returns the numbers of the versions of bundles that the document brings along, for a stage of its own."""
        return {key: str(version.number) for key, version in self.bundled.items()}

    def imported_digests(self) -> dict[str, str]:
        """Returns the SHA-256 of each world that the document imports, by ``<generation>/<world>``."""
        return {each.reference: each.digest for each in self.imported}

    def imported_by_name(self) -> dict[str, list[ImportedWorld]]:
        """Returns the worlds that the document imports, by the name of their entry: variants together."""
        found: dict[str, list[ImportedWorld]] = {}
        for each in self.imported:
            found.setdefault(each.name, []).append(each)
        return found

    def placed(self, spec: PipelineSpec) -> PipelineSpec:
        """Returns the document, which names the worlds that it imports by where they are in the store."""
        places: dict[str, list[str]] = {}
        for each in self.imported:
            for name in {each.name, each.world.name}:
                places.setdefault(name, []).append(each.reference)
        return place_worlds(spec, places)

    def bundled_digests(self) -> frozenset[str]:
        """Returns the SHA-256 of all builds of the bundles that the document brings along."""
        return frozenset(digest for each in self.bundled.values() for digest in (each.digest, *each.digests.values()))


@dataclass(frozen=True)
class ParsedRun:
    """A run of a document, as this process knows it: nothing of this is believed to the run's record.

    Attributes:
        spec: The document.
        base: Folder that the document's relative paths start from.
        store: Where everything is.
        run: The run.
        found: What the document refers to.
        worlds: ``<generation>/<world>`` of each world of the run.
    """

    spec: PipelineSpec
    base: str
    store: Store
    run: JobRecord
    found: Resolved = Resolved()
    worlds: Sequence[str] = ()

    def find(self) -> FindVersion:
        """Returns what finds versions as they were when the run began."""
        return finder(self.store, self.found.bundled)


def resolve_references(spec: PipelineSpec, store: Store, base: Path) -> Resolved:
    """Returns what a document refers to; bundles that it brings along are published, and worlds imported.

    Args:
        spec: The document.
        store: Where references lead.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: Something is missing or contradicts itself; carries every fault.
        StoreUnreachable: A bucket does not answer.
    """
    faults = KeptFaults()
    bundled: dict[str, Version] = {}
    spec = with_drafts(spec, base).spec
    faults.keep(partial(check_robot_files, spec, base))
    faults.keep(partial(check_modules, spec, base))
    for source in spec.applications:
        faults.keep(lambda source=source: bundled.update(_publish(source, store, base, spec)))
    entries = enumerate(spec.worlds or ())
    imported = [faults.keep(partial(_import, entry, number, store, base)) or [] for number, entry in entries]
    find, found = finder(store, bundled), Resolved(bundled, [each for some in imported for each in some])
    spec = found.placed(spec)
    if section := spec.worldGeneration:
        template = faults.keep(lambda: find_template(section.template, store, base))
        found = replace(found, template=template_digest(template) if template else "")
    if export := spec.worldExport:
        faults.keep(lambda: _require_bucket(store, export.outputLocation, "worldExport"))
        faults.keep(lambda: require_writable(export.formats, "document", "worldExport.formats"))
        worlds = () if export.worlds == "all" else export.worlds
        found = replace(found, exported=faults.keep(lambda: world_digests(worlds, store)))
    if batch := spec.simulationBatch:
        faults.keep(lambda: require_environment(os.environ))
        plan = faults.keep(lambda: _checked_plan(batch, store, find, worlds=bool(spec.worldGeneration or spec.worlds)))
        faults.keep(lambda: check_planned_names(spec.gate, plan, store) if plan else None)
        faults.keep(lambda: check_planned_confinement(plan, store) if plan else None)
        compared = faults.keep(lambda: compared_digest(spec.gate, batch, find))
        against = spec.search.against if spec.search else None
        faults.keep(lambda: other_digest(against, batch, find, "search.against"))
        if spec.gate and plan:
            judged = plan
            faults.keep(lambda: require_one_version(judged, compared or ""))
        found = replace(found, batch=plan, compared_with=compared or "")
    if (deployment := spec.deployment) and not faults:
        tested = tested_bundles(found.batch, found.compared_with) if found.batch else None
        folder = _brought_from(spec, deployment)
        version = faults.keep(lambda: _deployable_version(deployment, tested, store, find, folder))
        batch_judged, other = found.batch if spec.gate else None, found.compared_with
        ships = faults.keep(lambda: _shipment(deployment, version, batch_judged, other)) if version else None
        found = replace(found, deployed=version, ships=ships)
    if faults:
        raise faults.together()
    return found


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


def _import(entry: WorldImport, number: int, store: Store, base: Path) -> list[ImportedWorld]:
    path = f"worlds[{number}]"
    imported = import_worlds(entry, base, path)
    for each in imported:
        keep_world(store, each, path)
    return imported


def _checked_plan(section: SimulationBatch, store: Store, find: FindVersion, *, worlds: bool) -> BatchPlan:
    """Returns the plan of a batch whose output bucket is there, and whose bundles have what is launched.

    Args:
        section: The document's section.
        store: Where everything is.
        find: Finds versions.
        worlds: Whether the document generates or imports worlds, so that its requests need none of their own.
    """
    faults = KeptFaults()
    faults.keep(lambda: _require_bucket(store, output_location(section), "simulationBatch"))
    faults.keep(lambda: require_bag_writers(section.recordings.bags))
    plan = faults.keep(lambda: batch_plan(section, None if worlds else (), store, find))
    if plan and not worlds and (fault := worldless_fault(plan)):
        faults.add([fault])
    if plan:
        faults.add(launch_faults(plan, store))
    if plan is None or faults:
        raise faults.together()
    return plan


def _shipment(section: Deployment, version: Version, plan: BatchPlan | None, other: str) -> Shipment:
    return judged_shipment(section, version, plan, candidates(plan, other)) if plan else shipment_of(section, version)


def _brought_from(spec: PipelineSpec, section: Deployment) -> str:
    """Returns the folder of the document's own bundle that a section deploys; empty if it deploys another one."""
    use = section.deploymentApplicationConfigs[0]
    name = reference_path(use.application) if use.applicationVersion in {None, LATEST} else ""
    return next((each.source for each in spec.applications if (each.kind, each.name) == ("robot", name)), "")


def _deployable_version(
    section: Deployment, tested: dict[str, str] | None, store: Store, find: FindVersion, folder: str
) -> Version:
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
        source=folder,
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


def _require_bucket(store: Store, location: OutputLocation, section: str) -> None:
    """Refuses an output bucket that a server does not have.

    Raises:
        DocumentError: There is no such bucket.
        StoreUnreachable: Nothing answers.
    """
    bucket = location.s3Bucket or ""
    try:
        open_bucket(store, bucket)
    except BucketNotFound as exc:
        raise DocumentError.of(f"{section}.outputLocation.s3Bucket", repr(bucket), f"a bucket; {exc}") from exc


def _key(kind: ApplicationKind, name: str) -> str:
    return f"{kind}/{name}"


def _kind(text: str) -> ApplicationKind:
    return "robot-application" if text == "robot-application" else "simulation-application"


_FOLDER = "file://"
_NAMED_AT_MOST = 10


# A misspelt bucket would take the results and say nothing. To refuse it would break the first steps, and old
# documents whose buckets nobody makes on a new machine; so `plan` and `run` name what is new, and what is there.
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
