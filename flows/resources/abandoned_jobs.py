"""Abandoned jobs, which are under way while nobody works on them: finds them, and ends or releases them.

A process that was killed leaves its job InProgress or Running, and leaves its claim. Nobody renews the claim any more,
and that shows that the job is abandoned. RoboMaker has no word for this, so the status stays what it is.
"""

import logging
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

from flows.resources.kinds import KINDS, cancel_resource, close_stopped_batch
from specs.arn import list_name, parse_reference
from specs.base import Spec
from specs.errors import DocumentError, ResourceNotFound, SimyardError
from specs.job_kinds import JOB_KINDS, JobKind
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import ClaimWatch
from tasks.storage.jobs.job_index import records_under_way
from tasks.storage.jobs.queue import is_queued
from tasks.storage.jobs.records import JobRecord, is_terminal, read, records
from tasks.storage.jobs.runs import KIND as RUN
from tasks.storage.jobs.runs import document_of_run, run_of

_LOG = logging.getLogger(__name__)
_LOOK_S = 0.5
_PATIENCE_S = 60.0


class ReapedJob(Spec):
    """An abandoned job after it was reaped.

    Attributes:
        was: Its status before.
        status: Its status now; a terminal one if it was being stopped, or can never be continued.
        meaning: What that means, for a person.
    """

    arn: str
    was: str
    status: str
    meaning: str


@dataclass(frozen=True)
class _Suspect:
    """A job under way, with its own claim and its run's; a process that works on the job renews one of them."""

    record: JobRecord
    watches: tuple[ClaimWatch, ...]

    def is_left(self) -> bool:
        looks = [watch.is_left() for watch in self.watches]  # every one, each time: how else would they see a heartbeat
        return all(looks)

    def is_alive(self) -> bool:
        return any(watch.renewed for watch in self.watches)


def kind_notes(store: Store, plural: str) -> Iterator[str]:
    """Yields a line for each job of a kind, by its plural, that is abandoned for certain.

    Where a process on another machine may live, nothing is said: to find that out takes seconds, and `reap_jobs` does.
    """
    kinds: list[JobKind] = [kind for kind in JOB_KINDS if KINDS[kind].plural == plural]
    left = [record for kind in kinds for record in records_under_way(store, kind) if _is_left(store, record)]
    runs = records(store, RUN) if left else []
    outdated = [record for record in left if _is_outdated(record, runs)]
    yield from (_note(store, record, runs) for record in left if record not in outdated)
    if outdated:
        several = len(outdated) > 1
        what = f"{len(outdated)} abandoned {list_name(kinds[0]) if several else kinds[0]}"
        whose = "of documents that were changed and have" if several else "of a document that was changed and has"
        yield f"{what}, {whose} ended since: simyard reap --outdated cancels {'them' if several else 'it'}"


def job_notes(store: Store, arn: str) -> Iterator[str]:
    """Yields a line if the job that an ARN names is abandoned for certain; nothing for what is no job."""
    reference = parse_reference(arn)
    for kind in JOB_KINDS:
        if reference.kind == kind:
            record = read(store, kind, reference.path)
            if _is_left(store, record):
                yield _note(store, record, records(store, RUN))


def _is_left(store: Store, record: JobRecord) -> bool:
    waits = is_terminal(record) or is_queued(store, record.kind, record.id)
    return not waits and _suspect(store, record).is_left()


def _note(store: Store, record: JobRecord, runs: Sequence[JobRecord]) -> str:
    return f"{record.arn} is {record.status}, and nobody works on it: {_continuation(store, record, runs)}"


def _is_outdated(record: JobRecord, runs: Sequence[JobRecord]) -> bool:
    """Returns whether the document that a job is of was changed, and has run to its end in its new form.

    A document is known by its name. Whether it will ever be given in its old form again, nobody can tell.
    """
    own = record.id if record.kind == RUN else run_of(record.token)
    run = next((each for each in runs if each.id == own), None)
    return run is not None and any(
        is_terminal(each)
        and each.created_at_s > run.created_at_s
        and each.request_digest != run.request_digest
        and each.request.get("flow") == run.request.get("flow") == "pipeline"
        and document_of_run(each) == document_of_run(run)
        for each in runs
    )


def under_way(store: Store) -> list[JobRecord]:
    """Returns the jobs that have not ended, oldest first of each kind."""
    return [record for kind in JOB_KINDS for record in records_under_way(store, kind)]


def reap_jobs(
    store: Store,
    sleep: Callable[[float], None] = time.sleep,
    now_s: Callable[[], float] = time.monotonic,
    *,
    outdated: bool = False,
) -> list[ReapedJob]:
    """Ends or releases the abandoned jobs, and returns them, oldest first of each kind; other jobs are not touched.

    A job that was being cancelled or timed out comes to that end. A job whose run has ended is Canceled, because
    nothing will continue it. Every other job keeps its status, and its claim is released, so that the next run of its
    document continues it. A process on another machine lives if it renews its claim: no clocks are compared.

    Args:
        store: Where the jobs are.
        sleep: Waits so many seconds.
        now_s: A clock that never goes back.
        outdated: Whether to cancel those whose document was changed and has ended since, too.
    """
    found = list[ReapedJob]()
    active = under_way(store)
    runs = records(store, RUN)
    canceled = {record.id for record in active if outdated and _is_outdated(record, runs)}
    suspects = [_suspect(store, record, now_s) for record in active if not _waits_for_worker(store, record)]
    end_s = now_s() + _PATIENCE_S
    while suspects and now_s() < end_s:
        left = [suspect for suspect in suspects if suspect.is_left()]
        found += [_reap_or_explain(store, suspect, runs, canceled) for suspect in left]
        suspects = [each for each in suspects if each not in left and not each.is_alive()]
        if suspects:
            sleep(_LOOK_S)
    for suspect in suspects:
        _LOG.warning("%s: whether somebody works on it could not be seen in time; reap again", suspect.record.arn)
    return sorted(found, key=lambda each: [record.arn for record in active].index(each.arn))


def _waits_for_worker(store: Store, record: JobRecord) -> bool:
    """Returns whether a job is queued, and is to be worked on; one that is canceled may end without a worker."""
    stopped = record.status == "Canceling" or "canceled" in record.detail
    return not stopped and is_queued(store, record.kind, record.id)


def _suspect(store: Store, record: JobRecord, now_s: Callable[[], float] = time.monotonic) -> _Suspect:
    run = run_of(record.token) if record.kind != RUN else ""
    keys = [claim_key(record.kind, record.id), *([claim_key(RUN, run)] if run else [])]
    return _Suspect(record, tuple(ClaimWatch(store, key, now_s) for key in keys))


def _reap_or_explain(
    store: Store, suspect: _Suspect, runs: Sequence[JobRecord], canceled: Collection[str]
) -> ReapedJob:
    record = suspect.record
    try:
        return _reap_job(store, suspect, runs, canceled)
    except SimyardError as exc:  # of this job alone; the others are not left for it
        return ReapedJob(arn=record.arn, was=record.status, status=record.status, meaning=f"cannot be reaped: {exc}")


def _reap_job(store: Store, suspect: _Suspect, runs: Sequence[JobRecord], canceled: Collection[str]) -> ReapedJob:
    # `simyard list` and `describe` answer without what these import.
    from tasks.deploy.rollout.controller import CANCELED  # noqa: PLC0415 - see above

    record = suspect.record
    stopped = record.status == "Canceling" or CANCELED in record.detail
    if stopped or record.id in canceled or _is_orphan(store, record):
        with suppress(DocumentError):  # it ended since it was read, or is about to
            cancel_resource(store, record.arn)
    elif record.kind == "simulation-job-batch":
        close_stopped_batch(store, record.id)
    after = read(store, record.kind, record.id)
    if is_terminal(after):
        return ReapedJob(arn=record.arn, was=record.status, status=after.status, meaning=after.failure_reason)
    free = suspect.watches[0].release()
    meaning = _continuation(store, record, runs) if free else "somebody works on it again"
    return ReapedJob(arn=record.arn, was=record.status, status=after.status, meaning=meaning)


def _is_orphan(store: Store, record: JobRecord) -> bool:
    """Returns whether the job's run has ended: the document's next run makes another job."""
    run = run_of(record.token) if record.kind != RUN else ""
    try:
        return bool(run) and is_terminal(read(store, RUN, run))
    except ResourceNotFound:  # a token of somebody's own that looks like a run's
        return False


def _continuation(store: Store, record: JobRecord, runs: Sequence[JobRecord]) -> str:
    """Returns how a job is continued."""
    run: JobRecord | None = record if record.kind == RUN else None
    with suppress(ResourceNotFound):
        run = run or read(store, RUN, run_of(record.token) or "none")
    spec = run.request.get("spec") if run else None
    if run and isinstance(spec, dict) and run.request.get("flow") == "pipeline":
        if _is_outdated(record, runs):
            return (
                f"{spec.get('name')} was changed and has ended since; simyard cancel, or reap --outdated, ends this one"
            )
        goes_on = f"simyard run of {spec.get('name')} continues it if neither document nor applications have changed"
        return f"{goes_on}; simyard cancel {record.arn} ends it"
    return "the same request continues it"
