"""The store's errors for what went wrong between this process and an S3 server.

The status and code that the server sent decide, wherever they are in the chain of exceptions; botocore's own errors are
no OSErrors (docs/reference/store.md, section 5). Messages carry neither the server's text nor credentials.
"""

import os
from collections.abc import Mapping
from typing import Protocol, TypeGuard
from urllib.parse import urlsplit

from botocore.exceptions import (
    BotoCoreError,
    ClientError,
    CredentialRetrievalError,
    NoCredentialsError,
    PartialCredentialsError,
    ProfileNotFound,
)

from specs.errors import (
    BucketNotFound,
    ObjectConflict,
    ObjectNotFound,
    StoreAccessDenied,
    StoreAway,
    StoreError,
    StoreFull,
    StoreThrottled,
    StoreUnreachable,
)
from tasks.storage.base.disk_space import NO_ROOM

FAULTS = (OSError, BotoCoreError, ClientError)
_NO_CREDENTIALS = (NoCredentialsError, PartialCredentialsError, CredentialRetrievalError, ProfileNotFound)
_NO_ANSWER = (TimeoutError, ConnectionError, BotoCoreError)
_DENIED_CODES = frozenset({"AccessDenied", "ExpiredToken", "InvalidToken", "InvalidAccessKeyId"})
_SKEWED_CODES = frozenset({"RequestTimeTooSkewed", "RequestExpired", "RequestInTheFuture"})
_THROTTLED_CODES = frozenset(
    {"SlowDown", "Throttling", "ThrottlingException", "RequestThrottled", "RequestLimitExceeded", "TooManyRequests"}
)
_FULL_CODES = frozenset({"EntityTooLarge", "QuotaExceeded", "XMinioStorageFull", "InsufficientCapacity"})
_TOO_MANY_REQUESTS, _NO_ROOM = 429, 507
_ENDPOINTS = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL")
_CREDENTIALS = "check AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE"


class _Answered(Protocol):
    response: Mapping[str, Mapping[str, object]]


def s3_error(exc: BaseException, url: str, key: str) -> StoreError:
    """Returns the store's error for one of FAULTS that came up while working on the key.

    Args:
        exc: What botocore raised.
        url: The store's.
        key: Relative to the store.
    """
    place = f"{url}: {key}"
    status, code = _answer(exc)
    if status:
        return _refusal(status, code, place)
    if isinstance(exc, _NO_CREDENTIALS):
        return StoreAccessDenied(f"{place}: no usable credentials ({type(exc).__name__}); {_CREDENTIALS}")
    if isinstance(exc, OSError) and not isinstance(exc, _NO_ANSWER):
        kind = StoreFull if exc.errno in NO_ROOM else StoreError  # of this machine
        return kind(f"{place}: {exc.strerror or exc}")
    return StoreAway(f"{place}: no answer from {_endpoint()} ({type(exc).__name__}); is it running and reachable?")


def _refusal(status: int, code: str, place: str) -> StoreError:
    if code == "NoSuchBucket":
        return BucketNotFound(f"{place}: the bucket does not exist; create it, or name another")
    if status == 404:
        return ObjectNotFound(f"{place}: no such object")
    if status in {409, 412}:
        return ObjectConflict(f"{place}: has changed since it was read")
    if code in _SKEWED_CODES:
        remedy = "set this machine's clock, or have it set (NTP), and run the same command again"
        return StoreUnreachable(f"{place}: this machine's clock is not {_endpoint()}'s ({code}, {status}); {remedy}")
    if status in {401, 403} or code in _DENIED_CODES:
        return StoreAccessDenied(f"{place}: refused ({code}, {status}); {_CREDENTIALS}, and what they are allowed")
    return _disturbance(status, code, place)


def _disturbance(status: int, code: str, place: str) -> StoreError:
    if status == _TOO_MANY_REQUESTS or code in _THROTTLED_CODES:
        return StoreThrottled(f"{place}: {_endpoint()} asks for fewer requests ({code}, {status}); try again later")
    if status == _NO_ROOM or code in _FULL_CODES:
        return StoreFull(f"{place}: {_endpoint()} has no room for it ({code}, {status})")
    if status >= 500:
        return StoreAway(f"{place}: {_endpoint()} answers {code} ({status}); its log says why, such as a full disk")
    if 300 <= status < 400:
        return StoreUnreachable(f"{place}: the bucket lies elsewhere ({code}, {status}); set AWS_REGION to its region")
    return StoreError(f"{place}: {_endpoint()} answers {code} ({status})")


def _answer(exc: BaseException | None) -> tuple[int, str]:
    while exc is not None:
        if _has_answer(exc):
            status = exc.response.get("ResponseMetadata", {}).get("HTTPStatusCode", 0)
            return status if isinstance(status, int) else 0, str(exc.response.get("Error", {}).get("Code", ""))
        exc = exc.__cause__
    return 0, ""


def _has_answer(exc: object) -> TypeGuard[_Answered]:
    return isinstance(getattr(exc, "response", None), dict)


def _endpoint() -> str:
    for name in _ENDPOINTS:
        if url := os.environ.get(name):
            parts = urlsplit(url)
            return f"{parts.hostname}:{parts.port} ({name})" if parts.port else f"{parts.hostname} ({name})"
    return "Amazon S3"
