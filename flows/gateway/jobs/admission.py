"""How a job is admitted: checked, put into the queue and recorded, once for each token; a worker does the rest.

The entry of the queue is made before the record. A gateway that dies in between leaves an entry of no job, and the same
call again completes it.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Protocol
from uuid import uuid4

from pydantic import JsonValue

from flows.gateway.jobs.quota import require_place
from specs.base import Fault, Spec
from specs.digest import canonical_document
from specs.errors import DocumentError, IdempotentParameterMismatch, ResourceNotFound
from specs.interface.quotas import Quota
from specs.job_kinds import JobKind
from tasks.storage.base.keys import token_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import enqueue, is_queued, leave_queue
from tasks.storage.jobs.records import JobRecord, is_terminal, job_id, read, submit
from tasks.storage.jobs.runs import run_of

Document = dict[str, JsonValue]
_LOOKS, _LOOK_EVERY_S = 20, 0.05
_TRIES = 2


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
    quota: Quota
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
        raise DocumentError([Fault(path="clientRequestToken", value=repr(admission.token), allowed=allowed)], "request")
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
        fault = Fault(path="clientRequestToken", value=repr(admission.token), allowed=allowed)
        raise IdempotentParameterMismatch([fault], source="request")
    return record


def _recorded(store: Store, admission: Admission, new: NewRecord) -> JobRecord:
    detail = {**admission.options, **new.detail}
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
