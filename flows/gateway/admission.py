"""How a job is admitted: checked, put into the queue and recorded, once for each token; a worker does the rest.

Its quota, its bucket and its cancellation are the queue's too. Answers about jobs have no paths of this machine.
"""

import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Protocol, TypeVar, cast
from uuid import uuid4

from pydantic import JsonValue

from specs.arn import parse_reference
from specs.base import Spec, canonical_document
from specs.errors import (
    BucketNotFound,
    DocumentError,
    IdempotentParameterMismatch,
    LimitExceeded,
    ObjectCorrupt,
    ObjectNotFound,
    ResourceNotFound,
    StoreAccessDenied,
)
from specs.job_kinds import JobKind
from specs.robomaker.operations import SIMULATION_JOBS
from specs.settings import CountSetting
from tasks.deploy.trust.trust_record import vouch_queued
from tasks.gateway.rest_json import without_places
from tasks.storage.base.keys import queue_prefix, token_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.queue import QueueEntry, enqueue, is_queued, leave_queue, queued_entry
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, job_id, read, submit
from tasks.storage.jobs.runs import run_of
from tasks.storage.tags import tags_of

SINGLE = "single"
"""The option of a batch's entry that says that it is a single simulation job."""
Document = dict[str, JsonValue]
_LOOKS, _LOOK_EVERY_S = 20, 0.05
_TRIES = 2
_STOPPED = frozenset({"Canceling", "Canceled"})
T = TypeVar("T", bound=Spec)
_REASON = "failureReason"


# A call puts its job into the queue before it counts, and takes it out again if there are too many. Two gateways at
# once therefore never admit one too many where the store's listings are current, as they are in a folder and on S3;
# of two calls for the last place both may be refused. Jobs of `simyard run` are not in the queue and do not count.
@contextmanager
def require_place(
    store: Store, kind: JobKind, job: str, quota: CountSetting, options: dict[str, JsonValue]
) -> Generator[None]:
    """Puts a job into the queue, to be recorded inside the ``with`` block; takes it out again if that fails.

    Raises:
        LimitExceeded: There are too many; the job is not in the queue.
    """
    enqueue(store, kind, job, options)
    try:
        require_room(store, kind, quota)
        yield
    except BaseException:
        _withdraw(store, kind, job, options)
        raise


def require_room(store: Store, kind: JobKind, quota: CountSetting) -> None:
    """Does nothing while the queue holds no more jobs than there may be.

    Raises:
        LimitExceeded: It holds more.
    """
    most, single = quota.value(), quota is SIMULATION_JOBS
    keys = store.keys(f"{queue_prefix()}/{kind}")
    # Only a full queue is read: some of it may have ended, or be of the other sort.
    if len(keys) <= most or len(_waiting(store, kind, keys, single=single)) <= most:
        return
    allowed = f"at most {most} {quota.what} ({quota.variable}); wait for one, or cancel one"
    raise LimitExceeded.of("request", "one more", allowed, source="request")


def _waiting(store: Store, kind: JobKind, keys: Sequence[str], *, single: bool) -> list[QueueEntry]:
    entries = [entry for key in keys if (entry := _entry(store, key)) and bool(entry.options.get(SINGLE)) == single]
    return [entry for entry in entries if not _has_ended(store, kind, entry.id)]


def _entry(store: Store, key: str) -> QueueEntry | None:
    try:
        return queued_entry(store, key)
    except (ObjectNotFound, ObjectCorrupt):  # a worker has removed it since it was listed, or a stranger wrote it
        return None


def _has_ended(store: Store, kind: JobKind, job: str) -> bool:
    try:
        return is_terminal(read(store, kind, job))
    except ResourceNotFound:  # about to be recorded
        return False


def _withdraw(store: Store, kind: JobKind, job: str, options: dict[str, JsonValue]) -> None:
    """Takes an entry out again, unless the same call elsewhere has recorded the job by now."""
    leave_queue(store, kind, job)
    try:
        read(store, kind, job)
    except ResourceNotFound:
        return
    if not is_queued(store, kind, job):
        enqueue(store, kind, job, options)


def require_output(store: Store, bucket: str | None, member: str) -> None:
    """Does nothing if a bucket is there.

    Args:
        store: Where it lies, if nothing else says so.
        bucket: Its name; None if the request has none.
        member: Where the request names it.

    Raises:
        DocumentError: The request names none, or there is none, or the credentials do not reach it.
        StoreError: Nothing answers.
    """
    if bucket is None:
        raise DocumentError.of(member, "none", "the name of a bucket", source="request")
    try:
        open_bucket(store, bucket)
    except BucketNotFound as exc:
        allowed = "a bucket that exists; SIMYARD_BUCKETS of the gateway says where buckets lie"
        raise DocumentError.of(member, repr(bucket), allowed, source="request") from exc
    except StoreAccessDenied as exc:
        allowed = "a bucket that the gateway's credentials reach"
        raise DocumentError.of(member, repr(bucket), allowed, source="request") from exc


# The entry of the queue is made before the record. A gateway that dies in between leaves an entry of no job, and the
# same call again completes it.
class Tokened(Protocol):
    """A request that may bring its token along."""

    @property
    def clientRequestToken(self) -> str | None:  # noqa: N802 - RoboMaker's name
        """What makes the request only once."""
        ...


@dataclass(frozen=True)
class NewRecord:
    """What the record of a job begins with.

    Attributes:
        request: What the job's token stands for.
        detail: What the record says besides.
    """

    request: Document
    detail: Document = field(default_factory=dict[str, JsonValue])


@dataclass(frozen=True)
class Admission:
    """A call that asks for a job.

    Attributes:
        kind: The kind of job.
        token: The client request token.
        asked: RoboMaker's request with its token, as JSON: what a repetition is compared with.
        asked_in: Returns what was asked for out of the record of a job that the token made before.
        checked: Checks everything and returns what the job's record begins with. Not called again for a repetition:
            worlds, versions and templates may have changed since.
        quota: How many such jobs there may be.
        options: What a worker must know beside the record.
        before_record: What has to be had before the job is recorded, such as its fleet; its id is given.
    """

    kind: JobKind
    token: str
    asked: Document
    asked_in: Callable[[JobRecord], Mapping[str, JsonValue]]
    checked: Callable[[], NewRecord]
    quota: CountSetting
    options: Document = field(default_factory=dict[str, JsonValue])
    before_record: Callable[[str], None] = lambda _: None

    @property
    def job(self) -> str:
        """Returns the id that the job has or will have."""
        return job_id(self.kind, self.token)


def token_of(request: Tokened) -> str:
    """Returns the token of a request; a new one for a request without."""
    return request.clientRequestToken or str(uuid4())


def asked_document(request: Spec, token: str) -> Document:
    """Returns a request as JSON, with its token."""
    return {**canonical_document(request), "clientRequestToken": token}


def without(document: Mapping[str, JsonValue], names: Iterable[str]) -> Document:
    """Returns a document without some of its fields."""
    left_out = set(names)
    return {name: value for name, value in document.items() if name not in left_out}


def admit(store: Store, admission: Admission) -> JobRecord:
    """Returns the job of a call's token, recorded and in the queue; a repeated call returns the job as it stands.

    Raises:
        DocumentError: The request cannot be done, or its token is one that a run of a document gives its jobs.
        IdempotentParameterMismatch: The token came with another request before.
        LimitExceeded: There are as many jobs of this kind as there may be.
    """
    if run_of(admission.token):
        allowed = "another token: those that begin with run- and 16 digits are of the jobs of documents"
        raise DocumentError.of("clientRequestToken", repr(admission.token), allowed, source="request")
    known = _known(store, admission)
    if known is None:
        new = admission.checked()
        with require_place(store, admission.kind, admission.job, admission.quota, admission.options):
            admission.before_record(admission.job)
            known = _recorded(store, admission, new)
    _keep_queued(store, admission, known)
    return known


def _known(store: Store, admission: Admission) -> JobRecord | None:
    """Returns the job that the same call has made before; None if there is none."""
    try:
        record = read(store, admission.kind, admission.job)
    except ResourceNotFound:
        return None
    if dict(admission.asked_in(record)) != admission.asked:
        allowed = f"another token: this one came before with another request, which made {record.id}"
        raise IdempotentParameterMismatch.of("clientRequestToken", repr(admission.token), allowed, source="request")
    return record


def _recorded(store: Store, admission: Admission, new: NewRecord) -> JobRecord:
    # What the call knows better, such as the bundle that a version stands for, stands in its own detail.
    detail = {**admission.options, **vouch_queued(admission.job, new.request), **new.detail}
    for _ in range(_TRIES):
        try:
            return submit(store, admission.kind, new.request, admission.token, detail=detail)
        except IdempotentParameterMismatch:
            # The same call at the same moment, elsewhere, while a version was published: the first to record it wins.
            if known := _awaited(store, admission):
                return known
            # Who came with the token died before the record; housekeeping would remove it as well.
            store.delete(token_key(admission.kind, admission.token))
    return submit(store, admission.kind, new.request, admission.token, detail=detail)


def _awaited(store: Store, admission: Admission) -> JobRecord | None:
    """Returns the job that somebody else is about to record; None if nobody does."""
    for _ in range(_LOOKS):
        if known := _known(store, admission):
            return known
        time.sleep(_LOOK_EVERY_S)
    return None


def _keep_queued(store: Store, admission: Admission, record: JobRecord) -> None:
    """Sees to it that a job which has not ended is in the queue, whoever took its entry for one of no job."""
    if not is_terminal(record) and not is_queued(store, admission.kind, record.id):
        enqueue(store, admission.kind, record.id, admission.options)
        with suppress(ResourceNotFound):
            if is_terminal(read(store, admission.kind, record.id)):
                leave_queue(store, admission.kind, record.id)


def cancel_recorded_job(store: Store, kind: JobKind, job: str) -> JobRecord:
    """Returns the record of a job of worlds that is being cancelled; one that nobody has begun is Canceled at once.

    Cancelling it again changes nothing.

    Raises:
        ResourceNotFound: No such job.
        DocumentError: It has ended otherwise.
    """
    record = advance(store, kind, job, "Canceled", only_from={"Pending"})
    record = advance(store, kind, job, "Canceling", only_from={"Running"}) if record.status == "Running" else record
    if record.status not in _STOPPED:
        raise ended(record.arn, record.status)
    if record.status == "Canceled":
        leave_queue(store, kind, job)
    else:
        enqueue(store, kind, job)  # who worked on it may have died: a worker ends it
    return record


def ended(arn: str, status: str) -> DocumentError:
    """Returns the error that says that a job cannot be cancelled any more."""
    return DocumentError.of("job", arn, f"a job that is under way; this one is {status}")


def answer_of(shape: type[T], described: Spec, store: Store) -> T:
    """Returns what a call answers of a job: those fields of its description that the call's shape has.

    Its tags are those that it has now: what somebody gave it later counts, and its outcome is never theirs to change.

    Args:
        shape: The call's answer.
        described: What the Describe call of the job's kind answers.
        store: Where the job is; its place need not be known to clients.
    """
    document = canonical_document(described)
    if "tags" in shape.model_fields:
        said = cast("Mapping[str, str] | None", document.get("tags"))
        document["tags"] = cast("JsonValue", tags_of(store, parse_reference(str(document["arn"])), said))
    fields: dict[str, JsonValue] = {name: document[name] for name in document if name in shape.model_fields}
    return shape.model_validate(placeless(fields, store))


def placeless(document: Mapping[str, JsonValue], store: Store) -> dict[str, JsonValue]:
    """Returns a document whose failure reasons say "the store" where they have the place of the store."""
    return {name: _placeless(value, store, name) for name, value in document.items()}


def _placeless(value: JsonValue, store: Store, name: str) -> JsonValue:
    if isinstance(value, dict):
        return placeless(value, store)
    if isinstance(value, list):
        return [_placeless(each, store, name) for each in value]
    return without_places(value, store.url) if isinstance(value, str) and name == _REASON else value
