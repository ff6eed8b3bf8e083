import errno
from pathlib import Path

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
from tasks.storage.backends.s3_access import S3Access
from tasks.storage.backends.s3_client import FAULTS, S3Client, s3_error
from tests.factories.gateway.answering_server import answering


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


@pytest.mark.parametrize(
    "endpoint", ["localhost:9000", "http://", "ftp://host", "http://host:port", "http://[::1", "http://host:0"]
)
def test_a_server_whose_url_leads_nowhere_is_a_wrong_setting(monkeypatch: pytest.MonkeyPatch, endpoint: str) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", endpoint)
    monkeypatch.delenv("AWS_ENDPOINT_URL_S3", raising=False)
    with pytest.raises(FAULTS) as raised:
        S3Client().call("head_bucket", Bucket="bucket")
    found = s3_error(raised.value, "s3://bucket", "key")
    assert type(found) is StoreUnreachable
    assert f"settings for AWS are wrong: AWS_ENDPOINT_URL is {endpoint!r}" in str(found)


@pytest.mark.parametrize("name", ["AWS_DEFAULT_REGION", "AWS_CONFIG_FILE"])
def test_a_wrong_setting_is_named_and_no_server_is_blamed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    broken = tmp_path / "config [broken"
    broken.write_text("[broken")
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.delenv("AWS_REGION", raising=False)
    monkeypatch.setenv(name, str(broken))
    with pytest.raises(FAULTS) as raised:
        S3Client(S3Access("id", "secret")).call("head_bucket", Bucket="bucket")
    said = str(s3_error(raised.value, "s3://bucket", "key"))
    assert "settings for AWS are wrong" in said
    assert str(broken) in said


def test_a_variable_that_botocore_cannot_read_is_a_wrong_setting(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    monkeypatch.setenv("AWS_METADATA_SERVICE_TIMEOUT", "soon")
    with pytest.raises(FAULTS) as raised:
        S3Client().call("head_bucket", Bucket="bucket")
    assert "settings for AWS are wrong: invalid literal" in str(s3_error(raised.value, "s3://bucket", "key"))


@pytest.mark.parametrize("proxy", ["http://127.0.0.1:9", "socks5://127.0.0.1:9"])
def test_no_proxy_stands_before_a_server_of_this_machine(monkeypatch: pytest.MonkeyPatch, proxy: str) -> None:
    for name in ("HTTP_PROXY", "http_proxy", "ALL_PROXY"):
        monkeypatch.setenv(name, proxy)
    for name in ("NO_PROXY", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
    with answering(404, b"") as url:
        client = S3Client(S3Access("id", "secret", region="us-east-1", endpoint=url.removesuffix("/api")))
        with pytest.raises(ClientError):
            client.call("get_object", Bucket="bucket", Key="key")


def test_no_credentials_is_denied() -> None:
    exc: BotoCoreError = NoCredentialsError()
    assert isinstance(s3_error(exc, "s3://bucket", "key"), StoreAccessDenied)


def test_a_full_disk_here_is_not_blamed_on_the_server() -> None:
    found = s3_error(OSError(errno.ENOSPC, "No space left on device"), "s3://bucket", "key")
    assert type(found) is StoreFull
    assert "No space left" in str(found)
