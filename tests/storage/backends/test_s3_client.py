import errno

import pytest
from botocore.exceptions import (
    BotoCoreError,
    ClientError,
    EndpointConnectionError,
    NoCredentialsError,
    ReadTimeoutError,
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
from tasks.storage.backends.s3_client import s3_error


def _refused(status: int, code: str) -> ClientError:
    response = {"Error": {"Code": code, "Message": "canary"}, "ResponseMetadata": {"HTTPStatusCode": status}}
    return ClientError(response, "PutObject")  # pyright: ignore[reportArgumentType] - the stub wants every header


@pytest.mark.parametrize(
    ("status", "code", "error"),
    [
        (404, "NoSuchKey", ObjectNotFound),
        (404, "404", ObjectNotFound),
        (404, "NoSuchBucket", BucketNotFound),
        (412, "PreconditionFailed", ObjectConflict),
        (409, "ConditionalRequestConflict", ObjectConflict),
        (403, "AccessDenied", StoreAccessDenied),
        (403, "InvalidAccessKeyId", StoreAccessDenied),
        (400, "ExpiredToken", StoreAccessDenied),
        (301, "PermanentRedirect", StoreUnreachable),
        (500, "InternalError", StoreAway),
        (503, "SlowDown", StoreThrottled),
        (429, "TooManyRequests", StoreThrottled),
        (400, "EntityTooLarge", StoreFull),
        (507, "XMinioStorageFull", StoreFull),
        (400, "MalformedXML", StoreError),
    ],
)
def test_status_and_code_decide_the_error(status: int, code: str, error: type[StoreError]) -> None:
    found = s3_error(_refused(status, code), "s3://bucket", "key")
    assert type(found) is error
    assert "canary" not in str(found)


def test_the_answer_is_found_behind_another_exception() -> None:
    translated = OSError(errno.EINVAL, "translated")
    translated.__cause__ = _refused(412, "PreconditionFailed")
    assert isinstance(s3_error(translated, "s3://bucket", "key"), ObjectConflict)


@pytest.mark.parametrize(
    "exc",
    [
        EndpointConnectionError(endpoint_url="http://user:canary@host"),
        ReadTimeoutError(endpoint_url="http://user:canary@host"),
        TimeoutError(),
        ConnectionResetError(),
    ],
)
def test_no_answer_means_unreachable(exc: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL_S3", "http://user:canary@host:81")
    found = s3_error(exc, "s3://bucket", "key")
    assert isinstance(found, StoreUnreachable)
    assert "host:81" in str(found)
    assert "canary" not in str(found)


def test_no_credentials_is_denied() -> None:
    exc: BotoCoreError = NoCredentialsError()
    assert isinstance(s3_error(exc, "s3://bucket", "key"), StoreAccessDenied)


def test_a_full_disk_here_is_not_blamed_on_the_server() -> None:
    found = s3_error(OSError(errno.ENOSPC, "No space left on device"), "s3://bucket", "key")
    assert type(found) is StoreFull
    assert "No space left" in str(found)
