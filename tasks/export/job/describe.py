"""An export job in RoboMaker's words: the answers of its calls, and why one failed."""

from pydantic import JsonValue

from specs.errors import (
    BucketNotFound,
    DocumentError,
    LimitExceeded,
    ObjectNotFound,
    ResourceNotFound,
    SimyardError,
    StoreAccessDenied,
    StoreAway,
    StoreFull,
    StoreThrottled,
)
from specs.robomaker.failure_codes import WorldExportJobErrorCode, told_code
from specs.robomaker.world_descriptions import DescribeWorldExportJobResponse, WorldExportJobSummary
from tasks.storage.jobs.records import JobRecord

_SUMMARISED = ("worlds", "outputLocation")
_DESCRIBED = (*_SUMMARISED, "iamRole", "tags")
_LONGEST_REASON = 1024  # GenericString

# The first that fits counts, so a subclass stands before its base.
_CODES: tuple[tuple[type[SimyardError], WorldExportJobErrorCode], ...] = (
    (StoreAccessDenied, "AccessDenied"),
    (ObjectNotFound, "ResourceNotFound"),
    (BucketNotFound, "ResourceNotFound"),  # a bucket that is gone (docs/reference/robomaker.md, section 7)
    (StoreThrottled, "RequestThrottled"),
    (StoreFull, "LimitExceeded"),
    (ResourceNotFound, "ResourceNotFound"),
    (LimitExceeded, "LimitExceeded"),
    (DocumentError, "InvalidInput"),
)


def describe_export_job(record: JobRecord) -> DescribeWorldExportJobResponse:
    """Returns the answer of DescribeWorldExportJob; what is empty is left out."""
    fields: dict[str, JsonValue] = {
        **_state(record),
        **_from_request(record, _DESCRIBED),
        "clientRequestToken": record.token,
    }
    if record.failure_code:
        code = told_code(record.failure_code, WorldExportJobErrorCode)
        fields |= {"failureCode": code, "failureReason": record.failure_reason}
    return DescribeWorldExportJobResponse.model_validate(fields)


def summarise_export_job(record: JobRecord) -> WorldExportJobSummary:
    """Returns the job's line in ListWorldExportJobs."""
    return WorldExportJobSummary.model_validate({**_state(record), **_from_request(record, _SUMMARISED)})


def failure_code(error: SimyardError) -> WorldExportJobErrorCode:
    """Returns RoboMaker's code for what went wrong; InternalServiceError for what no other fits."""
    for kind, code in _CODES:
        if isinstance(error, kind):
            return code
    return "InternalServiceError"


def is_outage(error: SimyardError) -> bool:
    """Returns whether nothing is wrong but that a store does not answer now: the job need not fail for that.

    RoboMaker has a code for a bucket that asks for fewer requests, even after a while of fewer: RequestThrottled.
    """
    return isinstance(error, StoreAway) and not isinstance(error, StoreThrottled)


def failure_reason(error: SimyardError) -> str:
    """Returns the error as one line of at most 1,024 characters, as RoboMaker's failureReason must be."""
    return " ".join(str(error).split())[:_LONGEST_REASON]


def _state(record: JobRecord) -> dict[str, JsonValue]:
    return {"arn": record.arn, "status": record.status, "createdAt": record.created_at_s}


def _from_request(record: JobRecord, names: tuple[str, ...]) -> dict[str, JsonValue]:
    return {name: record.request[name] for name in names if name in record.request}
