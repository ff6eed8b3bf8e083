"""The kinds of resources: how the commands describe, list and cancel one, and how far a job of one is.

What a kind needs is imported when it is asked for, so that the shell answers at once.
"""
# ruff: noqa: PLC0415 - see above

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, TypeVar

from pydantic import JsonValue

from specs.arn import ResourceKind, list_name
from specs.base import Spec
from specs.field_types import FilteredPage
from specs.job_kinds import JobKind
from tasks.storage.base.keys import worlds_prefix
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, is_terminal, read, records

StageProgress = tuple[str, int, int]
"""The stage that a run is at, and how many of how many worlds, episodes or robots of it are done."""

PageRequest = Mapping[str, JsonValue]
R = TypeVar("R", bound=FilteredPage)


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
    from tasks.worlds.job.describe import describe_template, list_templates

    return Resource(describe_template, list_templates)


def _world() -> Resource:
    from tasks.worlds.job.describe import describe_stored_world, list_worlds

    return Resource(describe_stored_world, list_worlds)


def _world_generation_job() -> Resource:
    from tasks.storage.jobs.cancellation import cancel_watched_job
    from tasks.worlds.job.describe import describe_generation_job, summarise_generation_job

    kind: JobKind = "world-generation-job"
    return Resource(
        lambda store, path: describe_generation_job(read(store, kind, path)),
        lambda store: [summarise_generation_job(each) for each in records(store, kind)],
        cancel=lambda store, path: cancel_watched_job(store, kind, path),
        progress=_worlds_made,
    )


def _world_export_job() -> Resource:
    from tasks.export.job.describe import describe_export_job, summarise_export_job
    from tasks.storage.jobs.cancellation import cancel_watched_job

    kind: JobKind = "world-export-job"
    return Resource(
        lambda store, path: describe_export_job(read(store, kind, path)),
        lambda store: [summarise_export_job(each) for each in records(store, kind)],
        cancel=lambda store, path: cancel_watched_job(store, kind, path),
        progress=lambda _, record: ("Export", int(is_terminal(record)), 1),
    )


def _robot_application() -> Resource:
    from tasks.applications.describe import describe_robot_application, list_robot_applications

    return Resource(describe_robot_application, list_robot_applications)


def _simulation_application() -> Resource:
    from tasks.applications.describe import describe_simulation_application, list_simulation_applications

    return Resource(describe_simulation_application, list_simulation_applications)


def _simulation_job() -> Resource:
    from flows.resource.stopped_batches import close_stopped_batch, close_stopped_batches
    from specs.robomaker.simulation import ListSimulationJobsRequest
    from tasks.simulate.batch.cancel_restart import cancel_job
    from tasks.simulate.batch.describe import describe_job, list_jobs, list_jobs_page

    page = _checked(ListSimulationJobsRequest, list_jobs_page)
    return Resource(
        lambda store, path: describe_job(store, close_stopped_batch(store, path)),
        lambda store: list_jobs(close_stopped_batches(store)),
        lambda store, request: page(close_stopped_batches(store), request),
        lambda store, path: (cancel_job(store, path), close_stopped_batch(store, path)),
    )


def _simulation_job_batch() -> Resource:
    from flows.resource.stopped_batches import close_stopped_batch, close_stopped_batches
    from specs.robomaker.simulation import ListSimulationJobBatchesRequest
    from tasks.simulate.batch.cancel_restart import cancel_batch
    from tasks.simulate.batch.describe import describe_batch, list_batches, list_batches_page

    page = _checked(ListSimulationJobBatchesRequest, list_batches_page)
    return Resource(
        lambda store, path: describe_batch(store, close_stopped_batch(store, path)),
        lambda store: list_batches(close_stopped_batches(store)),
        lambda store, request: page(close_stopped_batches(store), request),
        lambda store, path: (cancel_batch(store, path), close_stopped_batch(store, path)),
        _episodes_done,
    )


def _fleet() -> Resource:
    from specs.robomaker.fleet import ListFleetsRequest
    from tasks.deploy.answers.describe import describe_fleet, list_fleets
    from tasks.deploy.answers.list_pages import list_fleets_page

    return Resource(describe_fleet, list_fleets, _checked(ListFleetsRequest, list_fleets_page))


def _robot() -> Resource:
    from specs.robomaker.fleet import ListRobotsRequest
    from tasks.deploy.answers.describe import describe_robot, list_robots
    from tasks.deploy.answers.list_pages import list_robots_page

    return Resource(describe_robot, list_robots, _checked(ListRobotsRequest, list_robots_page))


def _deployment_job() -> Resource:
    from flows.resource.withdrawal import cancel_deployment
    from specs.robomaker.deployment import ListDeploymentJobsRequest
    from tasks.deploy.answers.describe import describe_deployment_job, list_deployment_jobs
    from tasks.deploy.answers.list_pages import list_deployment_jobs_page

    return Resource(
        describe_deployment_job,
        list_deployment_jobs,
        _checked(ListDeploymentJobsRequest, list_deployment_jobs_page),
        cancel_deployment,
        _robots_done,
    )


def _pipeline_run() -> Resource:
    from flows.resource.batch_columns import verdict_of, why_not
    from flows.resource.cancel import cancel_run
    from specs.data.run_report import RunSummary

    kind: JobKind = "pipeline-run"

    def summary(run: JobRecord) -> Spec:
        spec = run.request.get("spec", {})
        return RunSummary(
            arn=run.arn,
            name=str(spec.get("name", run.request.get("flow"))) if isinstance(spec, dict) else run.id,
            status=run.status,
            createdAt=run.created_at_s,
            verdict=verdict_of(run),
            failureReason=why_not(run),
        )

    return Resource(
        lambda store, path: read(store, kind, path),
        lambda store: [summary(run) for run in records(store, kind)],
        cancel=cancel_run,
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
    from tasks.simulate.batch.chunk_store import chunk_numbers
    from tasks.simulate.batch.job import load_batch

    layout = load_batch(store, record.id).layout
    done = sum(map(layout.chunk_size, chunk_numbers(store, record.id).committed))
    return "Episodes", done, layout.episodes


def _robots_done(_store: Store, record: JobRecord) -> StageProgress:
    from tasks.deploy.rollout.observation import count_in_sync, recorded_progress

    seen = recorded_progress(record)
    return "Deployment", count_in_sync(seen), max(1, len(seen))
