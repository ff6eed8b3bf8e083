"""The end of a queued job that cannot be done: Failed, with a code that RoboMaker has for its kind, and the reason."""

from collections.abc import Mapping
from typing import NamedTuple

from pydantic import JsonValue

from specs.errors import DocumentError, ResourceNotFound
from specs.job_kinds import JobKind
from specs.robomaker.failure_codes import JobFailureCode
from tasks.deploy.rollout.job_end import close_abandoned_job
from tasks.simulate.batch.job import lost_job_detail
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import Claim, hold_claim_unless_alive
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, read


class _Codes(NamedTuple):
    """The codes of a kind: what it refers to is missing, it can never be done, and it is Simyard that cannot."""

    missing: JobFailureCode
    refused: JobFailureCode
    inside: JobFailureCode


# Describe answers only the codes of the job's own kind.
CODES: Mapping[JobKind, _Codes] = {
    "world-generation-job": _Codes("ResourceNotFound", "InvalidInput", "InternalServiceError"),
    "world-export-job": _Codes("ResourceNotFound", "InvalidInput", "InternalServiceError"),
    "simulation-job-batch": _Codes("InternalServiceError", "InternalServiceError", "InternalServiceError"),
    "deployment-job": _Codes("ResourceNotFound", "InternalServerError", "InternalServerError"),
    "pipeline-run": _Codes("InvalidInput", "InvalidInput", "Failed"),
}
# What a description of the job's kind reads, whatever came of the job.
_NOTHING_MADE: Mapping[JobKind, dict[str, JsonValue]] = {
    "world-generation-job": {"worlds": [], "failures": {}},
}


def fail_job(store: Store, record: JobRecord, cause: Exception | str) -> JobRecord:
    """Returns the job's record, Failed, or Canceled if somebody cancels it; as it stands if somebody works on it.

    Args:
        store: Where it is.
        record: The job's.
        cause: Why it cannot be done.
    """
    with hold_claim_unless_alive(store, claim_key(record.kind, record.id)) as claim:
        if claim is None:
            return read(store, record.kind, record.id)
        return _end(store, read(store, record.kind, record.id), claim, cause)


def _end(store: Store, record: JobRecord, claim: Claim, cause: Exception | str) -> JobRecord:
    reason = str(cause)
    if is_terminal(record):
        return record
    if record.kind == "deployment-job":  # robots that it has announced are asked no more
        return close_abandoned_job(store, record, claim, reason, failure_code=_code(record.kind, cause))
    detail = {name: value for name, value in _NOTHING_MADE.get(record.kind, {}).items() if name not in record.detail}
    if record.status == "Canceling":
        return advance(store, record.kind, record.id, "Canceled", failure_reason=reason, detail=detail)
    code = _code(record.kind, cause)
    if record.kind == "simulation-job-batch":
        detail |= lost_job_detail(cause)
    return advance(store, record.kind, record.id, "Failed", failure_code=code, failure_reason=reason, detail=detail)


def _code(kind: JobKind, cause: Exception | str) -> JobFailureCode:
    codes = CODES[kind]
    if isinstance(cause, ResourceNotFound):
        return codes.missing
    return codes.refused if isinstance(cause, DocumentError) else codes.inside
