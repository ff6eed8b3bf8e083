"""Job records and client request tokens: the same request twice is one job, and an ended job stays as it ended.

The token is recorded before the job, and the job's id is made from kind and token, so that a process that dies between
the two leaves nothing that the next one does not complete.

A listener hears of each change of a job's status: a context variable, so that no function needs a parameter. It hears
of what is in the store already, from the process that changed it, so that a change is announced once at most however
often a job is killed and continued.
"""

import hashlib
import json
import logging
import time
from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from itertools import islice
from typing import NamedTuple

from pydantic import JsonValue

from specs.arn import RUN_KIND, absence, arn
from specs.base import Spec
from specs.errors import DocumentError, IdempotentParameterMismatch, ObjectExists, ResourceNotFound, StoreError
from specs.job_kinds import JOB_KINDS, JobKind
from specs.robomaker.failure_codes import JobFailureCode, require_code_of
from tasks.storage.base.keys import claim_key, job_key, jobs_prefix, token_key
from tasks.storage.base.store import Store, decode_document, encode_document, find_document, update
from tasks.storage.jobs.claim import hold_claim_unless_alive
from tasks.storage.store_url import store_id

_SHOWN = 3
_VALUE_CHARACTERS = 40
_NOTHING = "nothing"
logger = logging.getLogger(__name__)
TERMINAL = frozenset({"Completed", "PartialFailed", "Failed", "Succeeded", "TimedOut", "Canceled"})
_STATUSES = TERMINAL | {"Pending", "Preparing", "Running", "InProgress", "Completing", "Canceling", "TimingOut"}
_LONGEST_REASON = 1024
_EPOCH = "epoch"
_GOING = frozenset({"Pending", "Running", "Canceling"})


class JobToken(Spec):
    """A token, and which job it made of which request.

    Attributes:
        request_digest: SHA-256 of the request's canonical JSON.
        id: The job's.
    """

    token: str
    request_digest: str
    id: str


def token_mismatch(kind: JobKind, known: JobToken, digest: str, changes: str) -> IdempotentParameterMismatch:
    """Returns the refusal of a token that came before with another request.

    Args:
        kind: The kind of job.
        known: What the token stands for.
        digest: Of the request that comes now.
        changes: What differs; empty where the first request is not known any more.
    """
    what = f": {changes}" if changes else ""
    digests = f"request {known.request_digest}, now {digest}"
    allowed = f"came before with another request ({known.id}){what}; send the same one, or another token ({digests})"
    return IdempotentParameterMismatch.of("clientRequestToken", repr(known.token), allowed, source=kind)


def changes_text(before: JsonValue, after: JsonValue) -> str:
    """Returns the first fields that differ, each with both values, in one line."""
    found = list(islice(_changes(before, after, ""), _SHOWN + 1))
    return ", ".join(found[:_SHOWN]) + (", ..." if len(found) > _SHOWN else "")


def _changes(before: JsonValue, after: JsonValue, path: str) -> Iterator[str]:
    if isinstance(before, dict) and isinstance(after, dict):
        for key in sorted(before.keys() | after.keys()):
            yield from _changes(before.get(key), after.get(key), f"{path}.{key}" if path else key)
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for place, (old, new) in enumerate(zip(before, after, strict=True)):
            yield from _changes(old, new, f"{path}[{place}]")
    elif before != after:
        yield f"{path} was {_value(before)} and is {_value(after)}"


def _value(value: JsonValue) -> str:
    if value is None:
        return _NOTHING
    if isinstance(value, list):
        return f"a list of {len(value)}"
    text = repr(value)
    return text if len(text) <= _VALUE_CHARACTERS else f"{text[:_VALUE_CHARACTERS]}..."


class JobTransition(NamedTuple):
    """A job's change from one status to another.

    Attributes:
        kind: Of the job, such as ``simulation-job-batch``.
        arn: The job's.
        was: Its status before.
        status: Its status now.
        failure_code: RoboMaker's failure code, or empty.
        failure_reason: For a person, or empty.
        flow: The flow that a run is of: ``pipeline``, or a stage that runs alone; empty for any other job.
    """

    kind: JobKind
    arn: str
    was: str
    status: str
    failure_code: str
    failure_reason: str
    flow: str = ""


Listener = Callable[[JobTransition], None]


def _nobody(transition: JobTransition) -> None:
    """Drops what is told: nobody listens."""


_listener: ContextVar[Listener] = ContextVar("simyard_transition_listener", default=_nobody)


@contextmanager
def listen_to_transitions(listener: Listener) -> Generator[None, None, None]:
    """Lets the listener hear of transitions inside the ``with`` block; it must not raise."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def announce_transition(transition: JobTransition) -> None:
    """Tells the log, and the listener of this context, of a transition that is in the store."""
    fields = {name: value for name, value in transition._asdict().items() if value}
    why = [text for text in (transition.failure_code, transition.failure_reason) if text]
    logger.info("%s", ": ".join([f"{transition.arn} is {transition.status}", *why]), extra={"fields": fields})
    _listener.get()(transition)


class JobRecord(Spec):
    """What is known of a job.

    Attributes:
        token: The clientRequestToken it was submitted with.
        request_digest: SHA-256 of the request's canonical JSON.
        status: RoboMaker's status for this kind of job.
        failure_code: RoboMaker's failure code, or empty.
        failure_reason: What happened, for a person, or empty.
        created_at_s: Seconds since 1970, by the clock of the machine that submitted it.
        updated_at_s: Seconds since 1970, of the last advance.
        detail: What this kind of job has beyond the rest, such as the worlds it made.
    """

    kind: JobKind
    id: str
    arn: str
    token: str
    request_digest: str
    request: dict[str, JsonValue]
    status: str
    failure_code: str
    failure_reason: str
    created_at_s: float
    updated_at_s: float
    detail: dict[str, JsonValue]

    def answer(self, *names: str) -> dict[str, JsonValue]:
        """Returns what each of RoboMaker's answers about a job says, and those fields of its request that it has."""
        asked = {name: self.request[name] for name in names if name in self.request}
        return {"arn": self.arn, "status": self.status, "createdAt": self.created_at_s, **asked}


def request_digest(request: Mapping[str, JsonValue]) -> str:
    """Returns the SHA-256, in hex, of the request as JSON with sorted keys and no spaces."""
    text = json.dumps(request, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def job_id(kind: JobKind, token: str) -> str:
    """Returns the id of the job that the token makes, such as ``wgj-0123456789abcdef``."""
    return f"{JOB_KINDS[kind].prefix}-{hashlib.sha256(f'{kind}|{token}'.encode()).hexdigest()[:16]}"


def submit(
    store: Store,
    kind: JobKind,
    request: dict[str, JsonValue],
    token: str,
    *,
    detail: Mapping[str, JsonValue] | None = None,
) -> JobRecord:
    """Returns the job of the token: a new one, Pending, or the one that an equal request made before.

    Args:
        store: Where jobs are recorded.
        kind: The kind of job.
        request: RoboMaker's request, as JSON.
        token: The client request token.
        detail: What a new job's record has beyond the rest; no part of what the token stands for.

    Raises:
        IdempotentParameterMismatch: The token came with another request before
            (docs/reference/robomaker.md, section 2).
    """
    digest = request_digest(request)
    new = JobToken(token=token, request_digest=digest, id=job_id(kind, token))
    if not _record_token(store, kind, new, request):
        with suppress(ResourceNotFound):  # who recorded the token died before the record
            return _as_requested(store, read(store, kind, new.id), new, request)
    record = _new_record(store, kind, new, request, detail or {})
    try:
        store.create(job_key(kind, new.id), encode_document(record))
    except ObjectExists:
        return _as_requested(store, read(store, kind, new.id), new, request)
    # Housekeeping removes the token of a job without a record, then looks whether there is a record: one of us sees it.
    if not store.exists(token_key(kind, token)):
        _record_token(store, kind, new, request)
    return record


def advance(
    store: Store,
    kind: JobKind,
    id: str,  # noqa: A002 - the word every caller and record uses
    status: str,
    *,
    failure_code: JobFailureCode = "",
    failure_reason: str = "",
    detail: Mapping[str, JsonValue] | None = None,
    only_from: Collection[str] = _STATUSES,
    epoch: int = 0,
) -> JobRecord:
    """Returns the record after the change, written over exactly what was read; an ended job stays as it is.

    Args:
        store: Where jobs are recorded.
        kind: The kind of job.
        id: The job.
        status: The new one, one of RoboMaker's.
        failure_code: RoboMaker's code, or empty.
        failure_reason: For a person, or empty.
        detail: Merged into the record's, key by key.
        only_from: A job of any other status stays as it is: one that is being cancelled does not go on because its
            next step begins.
        epoch: That of the writer's claim; the record keeps it, and who comes with an older one was replaced.

    Raises:
        ResourceNotFound: No such job.
        StoreError: The record was written under a later epoch.
        ObjectConflict: Others wrote the record faster, a thousand times in a row.
        ValueError: The status is none of RoboMaker's, or the failure code none of this kind's.
    """
    if status not in _STATUSES:
        raise ValueError(f"{status!r} is no job status; they are {', '.join(sorted(_STATUSES))}")
    require_code_of(kind, failure_code)
    fields = {"status": status, "failure_code": failure_code, "failure_reason": _one_line(failure_reason)}
    return _advance(store, kind, id, _Change(fields, detail or {}, only_from, epoch))


def read(store: Store, kind: JobKind, id: str) -> JobRecord:  # noqa: A002 - the word every caller and record uses
    """Returns the record of a job.

    Raises:
        ResourceNotFound: No such job.
    """
    return _known(find_document(store, job_key(kind, id), JobRecord), store, kind, id)


def records(store: Store, kind: JobKind) -> list[JobRecord]:
    """Returns all jobs of a kind, oldest first, for showing to people (a listing may be late)."""
    found = (find_document(store, key, JobRecord) for key in store.keys(jobs_prefix(kind)))
    there = (record for record in found if record)  # the others were removed since they were listed
    return sorted(there, key=lambda record: (record.created_at_s, record.id))


def is_terminal(record: JobRecord) -> bool:
    """Returns whether the job has ended, and so will never change."""
    return record.status in TERMINAL


class _Change(NamedTuple):
    """What becomes of a record's fields and detail, from which statuses, under which epoch."""

    fields: Mapping[str, str]
    detail: Mapping[str, JsonValue]
    only_from: Collection[str]
    epoch: int


def _advance(store: Store, kind: JobKind, wanted: str, change: _Change) -> JobRecord:
    before: list[JobRecord] = []

    def step(found: JobRecord | None) -> JobRecord:
        record = _known(found, store, kind, wanted)
        before[:] = [record]
        if is_terminal(record) or record.status not in change.only_from:
            return record
        if change.epoch and change.epoch < _epoch(record):
            raise StoreError(
                f"{store.url}: {wanted} is another process's since epoch {_epoch(record)}; this one had {change.epoch}"
            )
        return _changed(record, change)

    after = update(store, job_key(kind, wanted), JobRecord, step)
    _announce(before[-1], after)
    return after


def _changed(before: JobRecord, change: _Change) -> JobRecord:
    added = dict(change.detail) | ({_EPOCH: change.epoch} if change.epoch else {})
    now_s = max(time.time(), before.updated_at_s)
    return before.model_copy(update={**change.fields, "updated_at_s": now_s, "detail": before.detail | added})


def _announce(before: JobRecord, after: JobRecord) -> None:
    if before.status != after.status:
        code, reason = after.failure_code, after.failure_reason
        flow = str(after.request.get("flow", "")) if after.kind == RUN_KIND else ""
        announce_transition(JobTransition(after.kind, after.arn, before.status, after.status, code, reason, flow))


def _epoch(record: JobRecord) -> int:
    found = record.detail.get(_EPOCH)
    return found if isinstance(found, int) else 0


def _one_line(reason: str) -> str:
    # RoboMaker's reasons are one line of at most 1024 characters; ours may be a document's many faults.
    return " ".join(reason.split())[:_LONGEST_REASON]


def _new_record(
    store: Store, kind: JobKind, new: JobToken, request: dict[str, JsonValue], detail: Mapping[str, JsonValue]
) -> JobRecord:
    now_s = time.time()
    return JobRecord(
        kind=kind,
        id=new.id,
        arn=arn(kind, store_id(store), new.id),
        token=new.token,
        request_digest=new.request_digest,
        request=request,
        status="Pending",
        failure_code="",
        failure_reason="",
        created_at_s=now_s,
        updated_at_s=now_s,
        detail=dict(detail),
    )


def _as_requested(store: Store, record: JobRecord, new: JobToken, request: dict[str, JsonValue]) -> JobRecord:
    """Returns the record of a job whose token was missing for a moment, if it was made for this very request."""
    if record.request_digest != new.request_digest:
        old = JobToken(token=record.token, request_digest=record.request_digest, id=record.id)
        raise _mismatch(store, record.kind, old, request)
    return record


def _record_token(store: Store, kind: JobKind, new: JobToken, request: dict[str, JsonValue]) -> bool:
    """Returns whether the token was new."""
    key = token_key(kind, new.token)
    try:
        store.create(key, encode_document(new))
    except ObjectExists:
        old = decode_document(JobToken, store.get(key), store, key)
        if old.request_digest != new.request_digest:
            raise _mismatch(store, kind, old, request) from None
        return False
    return True


def _mismatch(store: Store, kind: JobKind, old: JobToken, request: dict[str, JsonValue]) -> IdempotentParameterMismatch:
    try:
        changes = changes_text(read(store, kind, old.id).request, request)
    except ResourceNotFound:  # who sent it died before the record
        changes = ""
    return token_mismatch(kind, old, request_digest(request), changes)


def _known(found: JobRecord | None, store: Store, kind: JobKind, wanted: str) -> JobRecord:
    if found is None:
        raise ResourceNotFound.of(kind, repr(wanted), absence([kind], store.url), source="store")
    return found


def cancel_watched_job(store: Store, kind: JobKind, job: str) -> JobRecord:
    """Returns the record of a job that is being cancelled, or is Canceled at once where nobody works on it.

    Raises:
        ResourceNotFound: No such job.
        DocumentError: It has ended.
    """
    record = advance(store, kind, job, "Canceling", only_from=_GOING)
    if record.status != "Canceling":
        raise DocumentError.of(
            "arn", repr(job), f"a job that is under way; this one is {record.status}", source="simyard"
        )
    with hold_claim_unless_alive(store, claim_key(kind, job)) as claim:
        if claim is None:
            return record
        return advance(store, kind, job, "Canceled", only_from={"Canceling"})
