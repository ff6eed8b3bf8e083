"""`simyard describe`, `list` and `restart`: RoboMaker's answers, whatever the kind of resource."""

from collections.abc import Callable, Iterable, Mapping, Sequence

from flows.canceling import with_settled_batch, with_settled_batches
from specs.arn import KINDS, Reference, ResourceKind, parse_reference
from specs.base import Fault, Spec
from specs.errors import DocumentError
from specs.report import RunSummary
from specs.simulation import BatchDescribeSimulationJobRequest
from tasks.applications.describe import (
    describe_robot_application,
    describe_simulation_application,
    list_robot_applications,
    list_simulation_applications,
)
from tasks.deploy.describe import (
    describe_deployment_job,
    describe_fleet,
    describe_robot,
    list_deployment_jobs,
    list_fleets,
    list_robots,
)
from tasks.documents.parsing import parse
from tasks.export.describe import describe_export_job, summarise_export_job
from tasks.simulate.describe import batch_describe_jobs, describe_batch, describe_job, list_batches, list_jobs
from tasks.simulate.restarting import restart_job
from tasks.storage.records import JobRecord, read, records
from tasks.storage.store import Store
from tasks.worlds.describe import describe_generation_job, summarise_generation_job
from tasks.worlds.inspection import describe_stored_world, describe_template, list_templates, list_worlds

_DESCRIBE: Mapping[ResourceKind, Callable[[Store, str], Spec]] = {
    "world-template": describe_template,
    "world-generation-job": lambda store, path: describe_generation_job(read(store, "world-generation-job", path)),
    "world": describe_stored_world,
    "world-export-job": lambda store, path: describe_export_job(read(store, "world-export-job", path)),
    "robot-application": describe_robot_application,
    "simulation-application": describe_simulation_application,
    "simulation-job": lambda store, path: describe_job(store, with_settled_batch(store, path)),
    "simulation-job-batch": lambda store, path: describe_batch(store, with_settled_batch(store, path)),
    "deployment-fleet": describe_fleet,
    "robot": describe_robot,
    "deployment-job": describe_deployment_job,
}
_LIST: Mapping[str, Callable[[Store], Iterable[Spec]]] = {
    "world-templates": list_templates,
    "world-generation-jobs": lambda store: [
        summarise_generation_job(job) for job in records(store, "world-generation-job")
    ],
    "worlds": list_worlds,
    "world-export-jobs": lambda store: [summarise_export_job(job) for job in records(store, "world-export-job")],
    "robot-applications": list_robot_applications,
    "simulation-applications": list_simulation_applications,
    "simulation-jobs": lambda store: list_jobs(with_settled_batches(store)),
    "simulation-job-batches": lambda store: list_batches(with_settled_batches(store)),
    "fleets": list_fleets,
    "robots": list_robots,
    "deployment-jobs": list_deployment_jobs,
    "pipeline-runs": lambda store: [_run_line(run) for run in records(store, "pipeline-run")],
}


def described(store: Store, text: str) -> Spec:
    """Returns what the Describe call for an ARN answers; a run of a document, which RoboMaker had not, as it is kept.

    Raises:
        ResourceNotFound: The store has no such resource.
        DocumentError: The text is no ARN.
    """
    if text.startswith("arn:simyard:pipeline-run:"):
        return read(store, "pipeline-run", text.rpartition(":")[2])
    reference = _reference(text)
    if reference.kind is None:
        raise _refused("arn", text, f"an ARN, arn:simyard:<kind>:...; kinds are {', '.join(KINDS)}")
    return _DESCRIBE[reference.kind](store, reference.path)


def described_together(store: Store, arns: Sequence[str]) -> Spec:
    """Returns what BatchDescribeSimulationJob answers: the jobs, and the ARNs of those that do not exist.

    Raises:
        DocumentError: They are more than 100, or some of them no ARNs.
    """
    request = parse(BatchDescribeSimulationJobRequest, {"jobs": [*arns]}, "simyard")
    return batch_describe_jobs(store, request.jobs)


def listed(store: Store, kind: str) -> Iterable[Spec]:
    """Returns what the List call for a kind answers, all pages in one.

    Raises:
        DocumentError: There is no such kind.
    """
    if kind not in _LIST:
        raise _refused("kind", kind, f"one of {', '.join(_LIST)}")
    return _LIST[kind](store)


def restart(store: Store, text: str) -> None:
    """Restarts the simulation job that an ARN names.

    Raises:
        ResourceNotFound: The store has no such job.
        DocumentError: The text is no ARN of a job, or the job is not running.
    """
    reference = _reference(text)
    if reference.kind != "simulation-job":
        raise _refused("arn", text, "an ARN of a simulation-job")
    restart_job(store, with_settled_batch(store, reference.path))


def _run_line(run: JobRecord) -> RunSummary:
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
