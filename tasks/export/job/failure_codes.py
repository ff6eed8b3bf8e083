"""What RoboMaker calls the reasons for which an export fails (WorldExportJobErrorCode)."""

from specs.errors import (
    BucketNotFound,
    DocumentError,
    LimitExceeded,
    ObjectNotFound,
    ResourceNotFound,
    SimyardError,
    StoreAccessDenied,
    StoreFull,
    StoreThrottled,
)

_LONGEST_REASON = 1024  # GenericString

# The first that fits counts, so a subclass stands before its base.
_CODES: tuple[tuple[type[SimyardError], str], ...] = (
    (StoreAccessDenied, "AccessDenied"),
    (ObjectNotFound, "ResourceNotFound"),
    (BucketNotFound, "ResourceNotFound"),  # a bucket that is gone (docs/reference/robomaker.md, section 7)
    (StoreThrottled, "RequestThrottled"),
    (StoreFull, "LimitExceeded"),
    (ResourceNotFound, "ResourceNotFound"),
    (LimitExceeded, "LimitExceeded"),
    (DocumentError, "InvalidInput"),
)


def failure_code(error: SimyardError) -> str:
    """Returns RoboMaker's code for what went wrong; InternalServiceError for what no other fits."""
    return next((code for kind, code in _CODES if isinstance(error, kind)), "InternalServiceError")


def failure_reason(error: SimyardError) -> str:
    """Returns the error as one line of at most 1,024 characters, as RoboMaker's failureReason must be."""
    return " ".join(str(error).split())[:_LONGEST_REASON]
