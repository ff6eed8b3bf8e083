"""The kinds of resources: how the commands describe, list and cancel one, and how far a job of one is.

What a kind needs is imported when it is asked for, so that the shell answers at once.
"""
# ruff: noqa: PLC0415 - see above

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, TypeVar

from pydantic import JsonValue

from specs.arn import ResourceKind, list_name
from specs.base import Spec
from specs.field_types import Page
from specs.job_kinds import JobKind
from tasks.storage.base.keys import worlds_prefix
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, is_terminal, read

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
    from tasks.worlds.job.describe import describe_template
    from tasks.worlds.job.list_pages import list_templates, list_templates_page

    return Resource(describe_template, list_templates, _checked(ListWorldTemplatesRequest, list_templates_page))


def _world() -> Resource:
    from specs.robomaker.world_jobs import ListWorldsRequest
    from tasks.worlds.job.describe import describe_stored_world
    from tasks.worlds.job.list_pages import list_worlds, list_worlds_page

    return Resource(describe_stored_world, list_worlds, _checked(ListWorldsRequest, list_worlds_page))


def _world_generation_job() -> Resource:
    from specs.robomaker.world_jobs import ListWorldGenerationJobsRequest
    from tasks.storage.jobs.cancellation import cancel_watched_job
    from tasks.worlds.job.describe import describe_generation_job
    from tasks.worlds.job.list_pages import list_generation_jobs, list_generation_jobs_page

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
    from tasks.export.job.describe import describe_export_job
    from tasks.export.job.list_pages import list_export_jobs, list_export_jobs_page
    from tasks.storage.jobs.cancellation import cancel_watched_job

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
    from tasks.applications.describe import describe_robot_application
    from tasks.applications.list_pages import list_robot_applications, list_robot_applications_page

    page = _checked(ListRobotApplicationsRequest, list_robot_applications_page)
    return Resource(describe_robot_application, list_robot_applications, page)


def _simulation_application() -> Resource:
    from specs.robomaker.applications import ListSimulationApplicationsRequest
    from tasks.applications.describe import describe_simulation_application
    from tasks.applications.list_pages import list_simulation_applications, list_simulation_applications_page

    page = _checked(ListSimulationApplicationsRequest, list_simulation_applications_page)
    return Resource(describe_simulation_application, list_simulation_applications, page)


def _simulation_job() -> Resource:
    from flows.resource.stopped_batches import close_stopped_batch, close_stopped_batches
    from specs.robomaker.simulation import ListSimulationJobsRequest
    from tasks.simulate.batch.cancel_restart import cancel_job
    from tasks.simulate.batch.describe import describe_job
    from tasks.simulate.lists.job_pages import list_jobs, list_jobs_page

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
    from tasks.simulate.batch.describe import describe_batch
    from tasks.simulate.lists.job_pages import list_batches, list_batches_page

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
    from tasks.deploy.answers.describe import describe_fleet
    from tasks.deploy.answers.list_pages import list_fleets, list_fleets_page

    return Resource(describe_fleet, list_fleets, _checked(ListFleetsRequest, list_fleets_page))


def _robot() -> Resource:
    from specs.robomaker.fleet import ListRobotsRequest
    from tasks.deploy.answers.describe import describe_robot
    from tasks.deploy.answers.list_pages import list_robots, list_robots_page

    return Resource(describe_robot, list_robots, _checked(ListRobotsRequest, list_robots_page))


def _deployment_job() -> Resource:
    from flows.resource.withdrawal import cancel_deployment
    from specs.robomaker.deployment import ListDeploymentJobsRequest
    from tasks.deploy.answers.describe import describe_deployment_job
    from tasks.deploy.answers.list_pages import list_deployment_jobs, list_deployment_jobs_page

    return Resource(
        describe_deployment_job,
        list_deployment_jobs,
        _checked(ListDeploymentJobsRequest, list_deployment_jobs_page),
        cancel_deployment,
        _robots_done,
    )


def _pipeline_run() -> Resource:
    from flows.resource.cancel import cancel_run
    from flows.resource.run_pages import list_runs, list_runs_page
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
    from tasks.simulate.batch.chunk_store import chunk_numbers
    from tasks.simulate.batch.job import load_batch

    layout = load_batch(store, record.id).layout
    done = sum(map(layout.chunk_size, chunk_numbers(store, record.id).committed))
    return "Episodes", done, layout.episodes


def _robots_done(_store: Store, record: JobRecord) -> StageProgress:
    from tasks.deploy.rollout.observation import count_in_sync, recorded_progress

    seen = recorded_progress(record)
    return "Deployment", count_in_sync(seen), max(1, len(seen))
