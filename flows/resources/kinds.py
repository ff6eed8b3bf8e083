"""The kinds of resources: how the commands describe, list, cancel and restart one, and how far a job of one is.

What a kind needs is imported when it is asked for, so that the shell answers at once.
"""
# ruff: noqa: PLC0415 - see above

import logging
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple, TypeVar

from pydantic import JsonValue

from specs.arn import Reference, ResourceKind, list_name, parse_reference
from specs.base import Spec
from specs.errors import DocumentError, ResourceNotFound, StageFailed, StoreError
from specs.field_types import Page
from specs.job_kinds import JOB_KINDS, JobKind
from tasks.simulate.batch.batch_record import KIND as BATCH
from tasks.simulate.batch.batch_record import STOPPING
from tasks.storage.base.keys import claim_key, worlds_prefix
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim_unless_alive
from tasks.storage.jobs.job_index import records_under_way
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, read
from tasks.storage.jobs.runs import KIND as RUN
from tasks.storage.jobs.runs import jobs_of
from tasks.storage.resource_names import find_resource
from tasks.storage.tags import tags_of

logger = logging.getLogger(__name__)


def close_stopped_batch(store: Store, path: str) -> str:
    """Closes a batch that was stopped and abandoned; returns its path, ``<batch>`` or ``<batch>/<index>``, unchanged.

    A batch that cannot be closed now, because its output bucket is gone, stays as it is, and a warning says so.
    """
    batch = path.partition("/")[0]
    if read(store, BATCH, batch).status in STOPPING:
        from flows.batch.batch_end import close_if_stopped

        try:
            close_if_stopped(store, batch)
        except StoreError as exc:
            logger.warning("batch %s was stopped and cannot be closed: %s", batch, exc)
    return path


def close_stopped_batches(store: Store) -> Store:
    """Closes every batch that was stopped and abandoned; returns the store."""
    for record in records_under_way(store, BATCH):
        close_stopped_batch(store, record.id)
    return store


Described = TypeVar("Described", bound=Spec)


def with_tags_now(store: Store, kind: ResourceKind, path: str, described: Described) -> Described:
    """Returns a description with the tags that the resource has now; the outcome of a job stays among them.

    Args:
        store: Where the resource is.
        kind: Its kind.
        path: Its path, as in its ARN.
        described: What is told of it, with the tags of its request or record.
    """
    if "tags" not in type(described).model_fields:
        return described
    now = tags_of(store, Reference(kind=kind, path=path), getattr(described, "tags", None))
    return described.model_copy(update={"tags": now or None})


StageProgress = tuple[str, int, int]
"""The stage that a run is at, and how many of how many worlds, episodes or robots of it are done."""

PageRequest = Mapping[str, JsonValue]
R = TypeVar("R", bound=Page)


class Resource(NamedTuple):
    """What commands do to a kind of resource.

    Attributes:
        describe: Answers RoboMaker's Describe call for a path in the store.
        list: Answers its List call, all pages in one.
        page: Answers its List call, a page for a request; None for what has no pages.
        cancel: Cancels the one at a path; None for what nobody cancels.
        progress: Returns how far a job is; None for what is no stage of a run.
    """

    describe: Callable[[Store, str], Spec]
    list: Callable[[Store], Iterable[Spec]]
    page: Callable[[Store, PageRequest], Spec] | None = None
    cancel: Callable[[Store, str], object] | None = None
    progress: Callable[[Store, JobRecord], StageProgress] | None = None


class Kind(NamedTuple):
    """A kind of resource.

    Attributes:
        plural: What `simyard list` calls it.
        load: Returns what commands do to it, having imported what that needs.
    """

    plural: str
    load: Callable[[], Resource]


def _world_template() -> Resource:
    from specs.robomaker.world_jobs import ListWorldTemplatesRequest
    from tasks.worlds.job.world_answers import describe_template, list_templates, list_templates_page

    return Resource(describe_template, list_templates, _checked(ListWorldTemplatesRequest, list_templates_page))


def _world() -> Resource:
    from specs.robomaker.world_jobs import ListWorldsRequest
    from tasks.worlds.job.world_answers import describe_stored_world, list_worlds, list_worlds_page

    return Resource(describe_stored_world, list_worlds, _checked(ListWorldsRequest, list_worlds_page))


def _world_generation_job() -> Resource:
    from specs.robomaker.world_jobs import ListWorldGenerationJobsRequest
    from tasks.storage.jobs.records import cancel_watched_job
    from tasks.worlds.job.world_answers import describe_generation_job, list_generation_jobs, list_generation_jobs_page

    kind: JobKind = "world-generation-job"
    return Resource(
        lambda store, path: describe_generation_job(read(store, kind, path)),
        list_generation_jobs,
        _checked(ListWorldGenerationJobsRequest, list_generation_jobs_page),
        cancel=lambda store, path: cancel_watched_job(store, kind, path),
        progress=_worlds_made,
    )


def _world_export_job() -> Resource:
    from specs.robomaker.world_jobs import ListWorldExportJobsRequest
    from tasks.export.job.export_answers import describe_export_job, list_export_jobs, list_export_jobs_page
    from tasks.storage.jobs.records import cancel_watched_job

    kind: JobKind = "world-export-job"
    return Resource(
        lambda store, path: describe_export_job(read(store, kind, path)),
        list_export_jobs,
        _checked(ListWorldExportJobsRequest, list_export_jobs_page),
        cancel=lambda store, path: cancel_watched_job(store, kind, path),
        progress=lambda _, record: ("Export", int(is_terminal(record)), 1),
    )


def _robot_application() -> Resource:
    from specs.robomaker.applications import ListRobotApplicationsRequest
    from tasks.applications.application_answers import (
        describe_robot_application,
        list_robot_applications,
        list_robot_applications_page,
    )

    page = _checked(ListRobotApplicationsRequest, list_robot_applications_page)
    return Resource(describe_robot_application, list_robot_applications, page)


def _simulation_application() -> Resource:
    from specs.robomaker.applications import ListSimulationApplicationsRequest
    from tasks.applications.application_answers import (
        describe_simulation_application,
        list_simulation_applications,
        list_simulation_applications_page,
    )

    page = _checked(ListSimulationApplicationsRequest, list_simulation_applications_page)
    return Resource(describe_simulation_application, list_simulation_applications, page)


def _simulation_job() -> Resource:
    from specs.robomaker.simulation import ListSimulationJobsRequest
    from tasks.simulate.batch.batch_jobs import cancel_job, describe_job
    from tasks.simulate.batch.job_lists import list_jobs, list_jobs_page

    page = _checked(ListSimulationJobsRequest, list_jobs_page)
    return Resource(
        lambda store, path: describe_job(store, close_stopped_batch(store, path)),
        lambda store: list_jobs(close_stopped_batches(store)),
        lambda store, request: page(close_stopped_batches(store), request),
        lambda store, path: (cancel_job(store, path), close_stopped_batch(store, path)),
    )


def _simulation_job_batch() -> Resource:
    from specs.robomaker.simulation import ListSimulationJobBatchesRequest
    from tasks.simulate.batch.batch_jobs import cancel_batch, describe_batch
    from tasks.simulate.batch.job_lists import list_batches, list_batches_page

    page = _checked(ListSimulationJobBatchesRequest, list_batches_page)
    return Resource(
        lambda store, path: describe_batch(store, close_stopped_batch(store, path)),
        lambda store: list_batches(close_stopped_batches(store)),
        lambda store, request: page(close_stopped_batches(store), request),
        lambda store, path: (cancel_batch(store, path), close_stopped_batch(store, path)),
        _episodes_done,
    )


def _fleet() -> Resource:
    from specs.robomaker.deployment import ListFleetsRequest
    from tasks.deploy.fleet_descriptions import describe_fleet, list_fleets, list_fleets_page

    return Resource(describe_fleet, list_fleets, _checked(ListFleetsRequest, list_fleets_page))


def _robot() -> Resource:
    from specs.robomaker.deployment import ListRobotsRequest
    from tasks.deploy.fleet_descriptions import describe_robot, list_robots, list_robots_page

    return Resource(describe_robot, list_robots, _checked(ListRobotsRequest, list_robots_page))


def _deployment_job() -> Resource:
    from flows.resources.fleet_membership import cancel_deployment
    from specs.robomaker.deployment import ListDeploymentJobsRequest
    from tasks.deploy.fleet_descriptions import describe_deployment_job, list_deployment_jobs, list_deployment_jobs_page

    return Resource(
        describe_deployment_job,
        list_deployment_jobs,
        _checked(ListDeploymentJobsRequest, list_deployment_jobs_page),
        cancel_deployment,
        _robots_done,
    )


def _pipeline_run() -> Resource:
    from flows.resources.run_lists import list_runs, list_runs_page
    from specs.data.run_report import ListPipelineRunsRequest

    return Resource(
        lambda store, path: read(store, "pipeline-run", path),
        list_runs,
        _checked(ListPipelineRunsRequest, list_runs_page),
        cancel_run,
    )


_LOADS: Mapping[ResourceKind, Callable[[], Resource]] = {
    "world-template": _world_template,
    "world-generation-job": _world_generation_job,
    "world": _world,
    "world-export-job": _world_export_job,
    "robot-application": _robot_application,
    "simulation-application": _simulation_application,
    "simulation-job": _simulation_job,
    "simulation-job-batch": _simulation_job_batch,
    "deployment-fleet": _fleet,
    "robot": _robot,
    "deployment-job": _deployment_job,
    "pipeline-run": _pipeline_run,
}
KINDS: Mapping[ResourceKind, Kind] = {kind: Kind(list_name(kind), load) for kind, load in _LOADS.items()}


def _checked(request: type[R], page: Callable[[Store, R], Spec]) -> Callable[[Store, PageRequest], Spec]:
    """Returns a page function that takes a request as a document, and refuses one that breaks RoboMaker's limits."""

    def checked_page(store: Store, document: PageRequest) -> Spec:
        from tasks.documents.parse import parse

        return page(store, parse(request, {**document}, "simyard"))

    return checked_page


def _worlds_made(store: Store, record: JobRecord) -> StageProgress:
    from specs.robomaker.world_jobs import WorldCount

    counts = WorldCount.model_validate(record.request["worldCount"])
    wanted = (counts.floorplanCount or 1) * (counts.interiorCountPerFloorplan or 1)
    made = sum(1 for key in store.keys(worlds_prefix(record.id)) if key.endswith(".json"))
    return "Worlds", made, wanted


def _episodes_done(store: Store, record: JobRecord) -> StageProgress:
    from tasks.simulate.batch.batch_record import load_batch
    from tasks.simulate.batch.chunk_store import chunk_numbers

    layout = load_batch(store, record.id).layout
    done = sum(map(layout.chunk_size, chunk_numbers(store, record.id).committed))
    return "Episodes", done, layout.episodes


def _robots_done(_store: Store, record: JobRecord) -> StageProgress:
    from tasks.deploy.rollout.observation import count_in_sync, recorded_progress

    seen = recorded_progress(record)
    return "Deployment", count_in_sync(seen), max(1, len(seen))


REASON = "canceled on request"
CANCELED = "Canceled"
_GOING = frozenset({"Pending", "Running", "Canceling"})


def cancel_resource(store: Store, text: str) -> None:
    """Cancels a job or a run, by its ARN or id.

    A process that works on it stops within seconds; without one, it ends here and now.

    Raises:
        ResourceNotFound: The store has no such resource.
        DocumentError: It is of a kind that is not cancelled, or it has ended.
    """
    kind, path = find_resource(store, text, ("simulation-job", *JOB_KINDS))
    cancel_one = KINDS[kind].load().cancel
    if cancel_one is None:
        raise _refused_arn(text, f"what can be cancelled; a {kind} cannot")
    cancel_one(store, path)


def cancel_run(store: Store, run: str) -> JobRecord:
    """Returns the record of a run that is being cancelled, or is Canceled at once if no process works on it.

    Its jobs that have ended keep their results; the one that is under way is cancelled, and no other begins.

    Raises:
        ResourceNotFound: No such run.
        DocumentError: It has ended.
    """
    record = advance(store, RUN, run, "Canceling", only_from=_GOING)
    if record.status != "Canceling":
        raise _refused_arn(run, f"a run that is under way; this one is {record.status}")
    cancel_jobs(store, record)
    with hold_claim_unless_alive(store, claim_key(RUN, run)) as claim:
        return record if claim is None else end_canceled(store, record)


def end_canceled(store: Store, run: JobRecord) -> JobRecord:
    """Returns the record of a run, Canceled with the job that was under way; for who holds the run's claim."""
    advance(store, RUN, run.id, "Canceling", only_from=_GOING)
    cancel_jobs(store, run)
    return advance(
        store, RUN, run.id, "Canceled", failure_code="Canceled", failure_reason=REASON, only_from={"Canceling"}
    )


def cancel_jobs(store: Store, run: JobRecord, but_for: Collection[str] = ()) -> frozenset[str]:
    """Returns the ids of the jobs of a run that have not ended, having cancelled them.

    One that is about to end is left to that.

    Args:
        store: Where the run is.
        run: Whose jobs.
        but_for: Ids of jobs to leave alone.
    """
    found: set[str] = set()
    for kind, job in jobs_of(run):
        with suppress(ResourceNotFound):  # not begun
            record = read(store, kind, job)
            if job not in but_for and not is_terminal(record):
                found.add(job)
                with suppress(DocumentError):  # ended, or about to, since it was read
                    cancel_resource(store, record.arn)
    return frozenset(found)


def require_not_canceled(store: Store, run: JobRecord) -> None:
    """Does nothing while a run may begin its next stage.

    Raises:
        StageFailed: Somebody has cancelled it.
    """
    if read(store, RUN, run.id).status in {"Canceling", "Canceled"}:
        raise StageFailed("Canceled", REASON, run.arn)


def _refused_arn(value: str, allowed: str) -> DocumentError:
    return DocumentError.of("arn", repr(value), allowed, source="simyard")


_JOB: ResourceKind = "simulation-job"


def describe_resource(store: Store, text: str) -> Spec:
    """Returns what the Describe call for an ARN, an id or a name answers; for a run of a document, its record.

    Raises:
        ResourceNotFound: The store has no such resource.
        DocumentError: The text is an ARN of no kind of resource, or the name of several.
    """
    kind, path = find_resource(store, text, KINDS)
    return with_tags_now(store, kind, path, KINDS[kind].load().describe(store, path))


def describe_jobs(store: Store, arns: Sequence[str]) -> Spec:
    """Returns what BatchDescribeSimulationJob answers: the jobs, and the ARNs of those that do not exist.

    Raises:
        DocumentError: They are more than 100, or some of them no ARNs.
    """
    from specs.robomaker.simulation import BatchDescribeSimulationJobRequest
    from tasks.documents.parse import parse
    from tasks.simulate.batch.batch_jobs import batch_describe_jobs

    request = parse(BatchDescribeSimulationJobRequest, {"jobs": [*arns]}, "simyard")
    described = batch_describe_jobs(store, request.jobs)
    jobs = (with_tags_now(store, _JOB, parse_reference(str(job.arn)).path, job) for job in described.jobs or ())
    return described.model_copy(update={"jobs": tuple(jobs) or None})


def list_resources(store: Store, kind: str) -> Iterable[Spec]:
    """Returns what the List call for a kind answers, all pages in one.

    Raises:
        DocumentError: There is no such kind.
    """
    return _resource(kind).list(store)


def list_page(store: Store, kind: str, request: PageRequest) -> Spec:
    """Returns what the List call for a kind answers: one page, and the token of the next.

    Args:
        store: What is listed.
        kind: The kind's plural.
        request: The call's request: ``maxResults``, ``nextToken`` and ``filters``, each if wanted.

    Raises:
        DocumentError: There is no such kind, it has no pages, or the request is not one that RoboMaker takes.
    """
    page = _resource(kind).page
    if page is None:
        raise _refused("kind", kind, "a kind that has pages; this one is listed without them")
    return page(store, request)


def restart_named_job(store: Store, text: str) -> None:
    """Restarts the simulation job that an ARN or ``<batch>/<index>`` names.

    Raises:
        ResourceNotFound: The store has no such job.
        DocumentError: The text names something else, or the job is not running.
    """
    path = find_resource(store, text, ("simulation-job",)).path
    from tasks.simulate.batch.batch_jobs import restart_job

    restart_job(store, close_stopped_batch(store, path))


def _resource(plural: str) -> Resource:
    kinds = {each.plural: each for each in KINDS.values()}
    if plural not in kinds:
        raise _refused("kind", plural, f"one of {', '.join(kinds)}")
    return kinds[plural].load()


def _refused(path: str, value: str, allowed: str) -> DocumentError:
    return DocumentError.of(path, repr(value), allowed, source="simyard")
