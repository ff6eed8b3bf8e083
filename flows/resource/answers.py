"""`simyard describe`, `list` and `restart`: RoboMaker's answers, whatever the kind of resource.

What a kind needs is imported when it is asked for, so that the shell answers at once.
"""
# ruff: noqa: PLC0415 - see above

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple, TypeVar

from pydantic import JsonValue

from specs.arn import KINDS, RUN_KIND, Reference, ResourceKind, parse_reference, run_id
from specs.base import Fault, Spec
from specs.errors import DocumentError
from specs.field_types import FilteredPage
from specs.job_kinds import JobKind
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, read, records

PageRequest = Mapping[str, JsonValue]
R = TypeVar("R", bound=FilteredPage)


class Family(NamedTuple):
    """What is told of kinds of resources that belong together.

    Attributes:
        describe: RoboMaker's Describe call, by kind.
        list: Its List call, all pages in one, by the kind's plural.
        pages: Its List call, a page for a request, by the kind's plural; RoboMaker's request is checked first.
    """

    describe: Mapping[ResourceKind, Callable[[Store, str], Spec]]
    list: Mapping[str, Callable[[Store], Iterable[Spec]]]
    pages: Mapping[str, Callable[[Store, PageRequest], Spec]] = MappingProxyType({})


def _worlds() -> Family:
    from tasks.worlds.job.describe import (
        describe_generation_job,
        describe_stored_world,
        describe_template,
        list_templates,
        list_worlds,
        summarise_generation_job,
    )

    job: JobKind = "world-generation-job"
    return Family(
        {
            "world-template": describe_template,
            "world-generation-job": lambda store, path: describe_generation_job(read(store, job, path)),
            "world": describe_stored_world,
        },
        {
            "world-templates": list_templates,
            "world-generation-jobs": lambda store: [summarise_generation_job(each) for each in records(store, job)],
            "worlds": list_worlds,
        },
    )


def _exports() -> Family:
    from tasks.export.job.describe import describe_export_job, summarise_export_job

    job: JobKind = "world-export-job"
    return Family(
        {"world-export-job": lambda store, path: describe_export_job(read(store, job, path))},
        {"world-export-jobs": lambda store: [summarise_export_job(each) for each in records(store, job)]},
    )


def _applications() -> Family:
    from tasks.applications import describe

    return Family(
        {
            "robot-application": describe.describe_robot_application,
            "simulation-application": describe.describe_simulation_application,
        },
        {
            "robot-applications": describe.list_robot_applications,
            "simulation-applications": describe.list_simulation_applications,
        },
    )


def _simulations() -> Family:
    from flows.resource.cancel import close_stopped_batch, close_stopped_batches
    from specs.robomaker.simulation import ListSimulationJobBatchesRequest, ListSimulationJobsRequest
    from tasks.simulate.batch.describe import (
        describe_batch,
        describe_job,
        list_batches,
        list_batches_page,
        list_jobs,
        list_jobs_page,
    )

    jobs = _checked(ListSimulationJobsRequest, list_jobs_page)
    batches = _checked(ListSimulationJobBatchesRequest, list_batches_page)

    return Family(
        {
            "simulation-job": lambda store, path: describe_job(store, close_stopped_batch(store, path)),
            "simulation-job-batch": lambda store, path: describe_batch(store, close_stopped_batch(store, path)),
        },
        {
            "simulation-jobs": lambda store: list_jobs(close_stopped_batches(store)),
            "simulation-job-batches": lambda store: list_batches(close_stopped_batches(store)),
        },
        {
            "simulation-jobs": lambda store, request: jobs(close_stopped_batches(store), request),
            "simulation-job-batches": lambda store, request: batches(close_stopped_batches(store), request),
        },
    )


def _fleets() -> Family:
    from specs.robomaker.deployment import ListDeploymentJobsRequest
    from specs.robomaker.fleet import ListFleetsRequest, ListRobotsRequest
    from tasks.deploy.answers import describe
    from tasks.deploy.answers.list_pages import list_deployment_jobs_page, list_fleets_page, list_robots_page

    return Family(
        {
            "deployment-fleet": describe.describe_fleet,
            "robot": describe.describe_robot,
            "deployment-job": describe.describe_deployment_job,
        },
        {
            "fleets": describe.list_fleets,
            "robots": describe.list_robots,
            "deployment-jobs": describe.list_deployment_jobs,
        },
        {
            "fleets": _checked(ListFleetsRequest, list_fleets_page),
            "robots": _checked(ListRobotsRequest, list_robots_page),
            "deployment-jobs": _checked(ListDeploymentJobsRequest, list_deployment_jobs_page),
        },
    )


def _runs() -> Family:
    return Family({}, {"pipeline-runs": lambda store: [_run_line(run) for run in records(store, "pipeline-run")]})


_OF_KIND: Mapping[ResourceKind, Callable[[], Family]] = {
    "world-template": _worlds,
    "world-generation-job": _worlds,
    "world": _worlds,
    "world-export-job": _exports,
    "robot-application": _applications,
    "simulation-application": _applications,
    "simulation-job": _simulations,
    "simulation-job-batch": _simulations,
    "deployment-fleet": _fleets,
    "robot": _fleets,
    "deployment-job": _fleets,
}
_OF_PLURAL: Mapping[str, Callable[[], Family]] = {
    "world-templates": _worlds,
    "world-generation-jobs": _worlds,
    "worlds": _worlds,
    "world-export-jobs": _exports,
    "robot-applications": _applications,
    "simulation-applications": _applications,
    "simulation-jobs": _simulations,
    "simulation-job-batches": _simulations,
    "fleets": _fleets,
    "robots": _fleets,
    "deployment-jobs": _fleets,
    "pipeline-runs": _runs,
}


def describe_resource(store: Store, text: str) -> Spec:
    """Returns what the Describe call for an ARN answers; a run of a document, which RoboMaker had not, as it is kept.

    Raises:
        ResourceNotFound: The store has no such resource.
        DocumentError: The text is no ARN.
    """
    if run := run_id(text):
        return read(store, RUN_KIND, run)
    reference = _reference(text)
    if reference.kind is None:
        raise _refused("arn", text, f"an ARN, arn:simyard:<kind>:...; kinds are {', '.join(KINDS)}")
    return _OF_KIND[reference.kind]().describe[reference.kind](store, reference.path)


def describe_jobs(store: Store, arns: Sequence[str]) -> Spec:
    """Returns what BatchDescribeSimulationJob answers: the jobs, and the ARNs of those that do not exist.

    Raises:
        DocumentError: They are more than 100, or some of them no ARNs.
    """
    from specs.robomaker.simulation import BatchDescribeSimulationJobRequest
    from tasks.documents.parse import parse
    from tasks.simulate.batch.describe import batch_describe_jobs

    request = parse(BatchDescribeSimulationJobRequest, {"jobs": [*arns]}, "simyard")
    return batch_describe_jobs(store, request.jobs)


def listed(store: Store, kind: str) -> Iterable[Spec]:
    """Returns what the List call for a kind answers, all pages in one.

    Raises:
        DocumentError: There is no such kind.
    """
    return _family(kind).list[kind](store)


def list_page(store: Store, kind: str, request: PageRequest) -> Spec:
    """Returns what the List call for a kind answers: one page, and the token of the next.

    Args:
        store: What is listed.
        kind: The kind's plural.
        request: The call's request: ``maxResults``, ``nextToken`` and ``filters``, each if wanted.

    Raises:
        DocumentError: There is no such kind, or it has no pages; or the request is not one that RoboMaker takes.
    """
    pages = _family(kind).pages
    if kind not in pages:
        allowed = "fleets, robots, deployment-jobs, simulation-jobs or simulation-job-batches; others have no pages"
        raise _refused("kind", kind, allowed)
    return pages[kind](store, request)


def restart(store: Store, text: str) -> None:
    """Restarts the simulation job that an ARN names.

    Raises:
        ResourceNotFound: The store has no such job.
        DocumentError: The text is no ARN of a job, or the job is not running.
    """
    reference = _reference(text)
    if reference.kind != "simulation-job":
        raise _refused("arn", text, "an ARN of a simulation-job")
    from flows.resource.cancel import close_stopped_batch
    from tasks.simulate.batch.cancel_restart import restart_job

    restart_job(store, close_stopped_batch(store, reference.path))


def _family(kind: str) -> Family:
    if kind not in _OF_PLURAL:
        raise _refused("kind", kind, f"one of {', '.join(_OF_PLURAL)}")
    return _OF_PLURAL[kind]()


def _checked(request: type[R], page: Callable[[Store, R], Spec]) -> Callable[[Store, PageRequest], Spec]:
    """Returns a page function that takes a request as a document, and refuses one that breaks RoboMaker's limits."""

    def checked_page(store: Store, document: PageRequest) -> Spec:
        from tasks.documents.parse import parse

        return page(store, parse(request, {**document}, "simyard"))

    return checked_page


def _run_line(run: JobRecord) -> Spec:
    from specs.data.run_report import RunSummary

    name = run.request.get("spec", {})
    return RunSummary(
        arn=run.arn,
        name=str(name.get("name", run.request.get("flow"))) if isinstance(name, dict) else run.id,
        status=run.status,
        createdAt=run.created_at_s,
        failureReason=run.failure_reason or None,
    )


def _reference(text: str) -> Reference:
    try:
        return parse_reference(text)
    except ValueError as exc:
        raise _refused("arn", text, str(exc)) from exc


def _refused(path: str, value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path=path, value=repr(value), allowed=allowed)], source="simyard")
