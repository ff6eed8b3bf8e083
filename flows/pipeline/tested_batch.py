"""The batch that a document asks for: its plan, the versions it tests, and the version it compares them with."""

import hashlib
from collections.abc import Iterator, Sequence
from functools import cache

from flows.pipeline.bundle_checks import simulated_fault
from flows.pipeline.robot_drafts import with_store_drafts
from flows.pipeline.world_imports import keep_world, launched_world
from specs.arn import absence, parse_reference
from specs.base import Fault
from specs.data.episode import ApplicationLaunch
from specs.errors import DocumentError, KeptFaults, ObjectNotFound, ResourceNotFound
from specs.pipeline.gate_section import Gate, stops_early
from specs.pipeline.simulation_section import SimulationBatch
from specs.robomaker.bundle import ARCHITECTURES, ApplicationKind
from specs.robomaker.simulation import DataSourceConfig
from tasks.applications.registry import BUNDLE_ERRORS, bundle_failure
from tasks.simulate.data.data_sources import PinnedSource
from tasks.simulate.data.mounts import pin_source
from tasks.simulate.plan.batch_plan import BatchPlan, JobTemplate, lane_count
from tasks.simulate.plan.episode_layout import Layout
from tasks.simulate.plan.plan_batch import FindFiles, FindVersion, matrix_worlds, plan_batch, requested_worlds
from tasks.storage.archives import list_bundle_files
from tasks.storage.base.local_files import cache_folder
from tasks.storage.base.store import Store
from tasks.storage.worlds import world_bytes

_REQUESTS = "simulationBatch.createSimulationJobRequests[*]"


def batch_plan(
    section: SimulationBatch, worlds: Sequence[str] | None, store: Store, find: FindVersion, gate: Gate | None = None
) -> BatchPlan:
    """Returns the plan of a batch over the worlds that ``worlds: all`` means, and those that the section names.

    Args:
        section: The document's section.
        worlds: ``<generation>/<world>`` of each world that ``worlds: all`` means; None while a section of the document
            is still to make them.
        store: Where worlds and data are.
        find: Finds versions.
        gate: The document's gate if it may end the batch early; the plan is shuffled then.

    Raises:
        ResourceNotFound: Worlds or applications are missing; names all of them.
        DocumentError: A request cannot be run.
    """
    faults = KeptFaults()
    matrix = matrix_worlds(section, worlds or ())
    digests = faults.keep(lambda: world_digests([*matrix, *requested_worlds(section)], store))

    @cache
    def pin(source: str) -> PinnedSource:
        return pin_source(store, cache_folder() / "data", DataSourceConfig.model_validate_json(source))

    def planned() -> BatchPlan:
        files = bundle_files_in(store)
        return plan_batch(
            section, matrix, digests or {}, find, lambda one: pin(one.model_dump_json()), find_files=files
        )

    def drafted() -> BatchPlan:
        return with_store_drafts(planned(), store)

    plan = faults.keep(lambda: drafted() if worlds is None else with_launched_worlds(drafted(), section, store))
    if plan is None or faults:
        raise faults.together()
    return shuffle_if_endable(plan, gate)


def with_launched_worlds(plan: BatchPlan, section: SimulationBatch, store: Store) -> BatchPlan:
    """Returns a plan whose requests without a world have that of their simulation application's launch file.

    Where the plan has worlds for all requests, nothing is read. What is imported lies in the store afterwards.

    Raises:
        DocumentError: A launch file cannot be read, starts no world of Gazebo's, or its world cannot be imported.
    """
    templates, digests, faults = list[JobTemplate](), dict(plan.world_digests), KeptFaults()
    for template in plan.templates:
        scenario = template.scenario
        if plan.worlds_of(template) or not scenario.starts_nodes or scenario.command is not None:
            templates.append(template)
            continue
        launch, variables = template.scenario, template.judge_variables
        found = faults.keep(lambda launch=launch, own=variables: launched_world(store, launch, own))
        if found:
            keep_world(store, found, f"{_REQUESTS}.simulationApplications")
            digests[found.reference] = found.digest
            templates.append(template.model_copy(update={"worlds": (found.reference,)}))
    if faults:
        raise faults.together()
    if digests.keys() == plan.world_digests.keys():
        return plan
    changed = plan.model_copy(update={"templates": tuple(templates), "world_digests": digests})
    most = section.batchPolicy and section.batchPolicy.maxConcurrency
    return changed.model_copy(update={"lanes": lane_count(most, Layout(changed).episodes, changed.sharing)})


def worldless_fault(plan: BatchPlan) -> Fault | None:
    """Returns that a request of a batch has no world to run in; None if each has."""
    if all(map(plan.worlds_of, plan.templates)):
        return None
    allowed = "worldConfigs in each request, a list of worlds, or worldGeneration or worlds in the document"
    return Fault(path="simulationBatch.matrix.worlds", value="'all'", allowed=allowed)


def bundle_files_in(store: Store) -> FindFiles:
    """Returns what names the files of a store's bundles; none of one that cannot be used, which is told elsewhere."""

    @cache
    def names(digest: str) -> frozenset[str]:
        try:
            return frozenset(list_bundle_files(store, digest))
        except BUNDLE_ERRORS:
            return frozenset()

    return names


def shuffle_if_endable(plan: BatchPlan, gate: Gate | None) -> BatchPlan:
    """Returns the plan, shuffled if the gate may end the batch early.

    Episodes of several programs cannot be shuffled into common chunks, so that such a batch runs to its end, and is
    judged as one that does; unless the programs are two versions that a gate compares, which then take turns.
    """
    layout = Layout(plan)
    if gate is None or not stops_early(gate):
        return plan
    if gate.noWorseThan and layout.in_pairs():
        return plan.model_copy(update={"shuffled": "pairs"})
    return plan.model_copy(update={"shuffled": "episodes"}) if len(layout.programs()) == 1 else plan


def failing_sources(plan: BatchPlan) -> list[str]:
    """Returns which data sources of a batch cannot be used, and why: the jobs that need them will fail."""
    sources = plan.data_sources.values()
    return [f"{source.failure_code}: {source.failure_reason}" for source in sources if source.failure_code]


def launch_faults(plan: BatchPlan, store: Store) -> list[Fault]:
    """Returns a fault for each bundle that cannot be used, and for each launch file that is not in its bundle.

    Each stands once, however many requests launch it.
    """
    alone = [template.scenario for template in plan.templates if template.alone]
    launches = dict.fromkeys(plan.launches())
    return [fault for kind, each in launches for fault in _launch_faults(store, kind, each, alone=each in alone)]


def _launch_faults(store: Store, kind: ApplicationKind, launch: ApplicationLaunch, *, alone: bool) -> Iterator[Fault]:
    version = f"{launch.name} version {launch.version}"
    try:
        files = list_bundle_files(store, launch.digest)
    except BUNDLE_ERRORS as exc:
        failure = bundle_failure(store, kind, version, launch.digest, exc)
        field = "robotApplications" if kind == "robot-application" else "simulationApplications"
        yield Fault(path=f"{_REQUESTS}.{field}", value=version, allowed=f"a version whose bundle is whole; {failure}")
        return
    launched = (launch.package, launch.launch_file)
    if fault := simulated_fault(f"{_REQUESTS}.launchConfig", kind, launch.name, launched, files, alone=alone):
        yield fault


def world_digests(references: Sequence[str], store: Store) -> dict[str, str]:
    """Returns the SHA-256 of each world's document, by ``<generation>/<world>``.

    Raises:
        ResourceNotFound: Some are missing.
    """
    paths, faults = dict.fromkeys(parse_reference(reference).path for reference in references), KeptFaults()
    found = {path: faults.keep(lambda path=path: _world_digest(path, store)) for path in paths}
    if faults:
        raise faults.together()
    return {path: digest for path, digest in found.items() if digest}


def compared_digest(gate: Gate | None, batch: SimulationBatch, find: FindVersion) -> str:
    """Returns the digest of the version that a gate compares with; empty if it compares with none.

    Args:
        gate: The document's section.
        batch: The document's batch.
        find: Finds versions.

    Raises:
        ResourceNotFound: There is no such version.
    """
    rule = gate.noWorseThan if gate else None
    return other_digest(rule and rule.applicationVersion, batch, find, "gate.noWorseThan.applicationVersion")


def other_digest(version: str | None, batch: SimulationBatch, find: FindVersion, path: str) -> str:
    """Returns the digest of another version of the application that a batch tests; empty if there is not one.

    Args:
        version: Its number; None for none.
        batch: The document's batch.
        find: Finds versions.
        path: Where the document names it.

    Raises:
        ResourceNotFound: There is no such version.
    """
    uses = [use.application for request in batch.createSimulationJobRequests for use in request.robotApplications or ()]
    if version is None or len(set(uses)) != 1:
        return ""
    try:
        return find("robot-application", uses[0], version).digest
    except ResourceNotFound as exc:
        raise ResourceNotFound([fault.model_copy(update={"path": path}) for fault in exc.faults]) from exc


def candidates(plan: BatchPlan, baseline: str) -> frozenset[str]:
    """Returns the digests of the robot applications that a batch tests, apart from the one to compare with.

    A batch that has only that one tests it against itself.
    """
    own = frozenset(template.robot.digest for template in plan.templates)
    return own - {baseline} or own


def require_one_version(plan: BatchPlan, baseline: str) -> None:
    """Refuses a batch for a gate if it tests several versions, besides the one to compare with.

    An interval takes each episode for a draw of its own. Two versions that drive the same worlds and seeds are no such
    draws, and the rate over both is that of neither, while one of them ships. Builds of one version are that version.

    Args:
        plan: The batch.
        baseline: SHA-256 of the bundle that the gate compares with, or empty.

    Raises:
        DocumentError: It tests several.
    """
    meant = candidates(plan, baseline)
    launches = [template.robot for template in plan.templates if template.robot.digest in meant]
    tested = dict.fromkeys({each.digest: f"{each.name} version {each.version}" for each in launches}.values())
    if len(tested) > 1:
        allowed = (
            "a batch that tests one version, since its rules count all episodes together; name the other one in "
            "noWorseThan, or give each a document of its own"
        )
        raise DocumentError.of("gate", ", ".join(tested), allowed)


def tested_bundles(plan: BatchPlan, other: str) -> dict[str, str]:
    """Returns the digest of each robot application that a batch tests, by name, but for what it is compared with.

    Of several builds of a version it is that for X86_64, by whose digest the version is known.
    """
    launches: list[ApplicationLaunch] = [template.robot for template in plan.templates]
    launches.sort(key=lambda each: ARCHITECTURES.index(each.architecture or "X86_64"), reverse=True)
    meant = candidates(plan, other)
    return {launch.name: launch.digest for launch in launches if launch.digest in meant}


def _world_digest(path: str, store: Store) -> str:
    try:
        body = world_bytes(store, path)
    except ObjectNotFound as exc:
        raise ResourceNotFound.of("worlds", repr(path), absence(["world"], store.url)) from exc
    return hashlib.sha256(body).hexdigest()
