"""`simyard describe`, `list` and `restart`: RoboMaker's answers for every kind of resource.

What a kind needs is imported when it is asked for, so that the shell answers at once.
"""
# ruff: noqa: PLC0415 - see above

from collections.abc import Iterable, Sequence

from flows.resource.kinds import KINDS, PageRequest, Resource
from flows.resource.tags_now import with_tags_now
from specs.arn import ResourceKind, parse_reference
from specs.base import Fault, Spec
from specs.errors import DocumentError
from tasks.storage.base.store import Store
from tasks.storage.resource_names import find_resource

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
    from tasks.simulate.batch.describe import batch_describe_jobs

    request = parse(BatchDescribeSimulationJobRequest, {"jobs": [*arns]}, "simyard")
    told = batch_describe_jobs(store, request.jobs)
    jobs = (with_tags_now(store, _JOB, parse_reference(str(job.arn)).path, job) for job in told.jobs or ())
    return told.model_copy(update={"jobs": tuple(jobs) or None})


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
    from flows.resource.stopped_batches import close_stopped_batch
    from tasks.simulate.batch.cancel_restart import restart_job

    restart_job(store, close_stopped_batch(store, path))


def _resource(plural: str) -> Resource:
    kinds = {each.plural: each for each in KINDS.values()}
    if plural not in kinds:
        raise _refused("kind", plural, f"one of {', '.join(kinds)}")
    return kinds[plural].load()


def _refused(path: str, value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path=path, value=repr(value), allowed=allowed)], source="simyard")
