"""A client of an S3 server: its requests and answers, and the errors of the store for what went wrong."""

import base64
import functools
import hashlib
import io
import socket
import threading
import time
from collections.abc import Generator, Mapping
from http.client import HTTPResponse
from pathlib import Path
from typing import Any, Protocol, TypeGuard, cast
from urllib.parse import urlsplit

from botocore.awsrequest import (
    AWSHTTPConnection,
    AWSHTTPConnectionPool,
    AWSHTTPSConnection,
    AWSHTTPSConnectionPool,
)
from botocore.config import Config
from botocore.exceptions import (
    BotoCoreError,
    CapacityNotAvailableError,
    ClientError,
    CredentialRetrievalError,
    HTTPClientError,
    IncompleteReadError,
    InvalidConfigError,
    NoCredentialsError,
    PartialCredentialsError,
    ProfileNotFound,
    ProxyConnectionError,
)
from botocore.exceptions import ConnectionError as NoConnection
from botocore.handlers import add_expect_header
from botocore.loaders import Loader, create_loader
from botocore.session import Session

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
from tasks.storage.backends.s3_access import CONFIG, PART_BYTES, S3Access, chosen_endpoint, past_proxies
from tasks.storage.base.local_files import NO_ROOM

FAULTS = (OSError, BotoCoreError, ClientError)
_NO_CREDENTIALS = (NoCredentialsError, PartialCredentialsError, CredentialRetrievalError, ProfileNotFound)
_NO_ANSWER = (
    TimeoutError,
    ConnectionError,
    HTTPClientError,
    NoConnection,
    IncompleteReadError,
    CapacityNotAvailableError,
)
_DENIED_CODES = frozenset({"AccessDenied", "ExpiredToken", "InvalidToken", "InvalidAccessKeyId"})
_SKEWED_CODES = frozenset({"RequestTimeTooSkewed", "RequestExpired", "RequestInTheFuture"})
_THROTTLED_CODES = frozenset(
    {"SlowDown", "Throttling", "ThrottlingException", "RequestThrottled", "RequestLimitExceeded", "TooManyRequests"}
)
_FULL_CODES = frozenset({"EntityTooLarge", "QuotaExceeded", "XMinioStorageFull", "InsufficientCapacity"})
_TOO_MANY_REQUESTS, _NO_ROOM = 429, 507
_CREDENTIALS = "check AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE"
_SETTINGS = "look at the variables AWS_... and the files that AWS_CONFIG_FILE and AWS_SHARED_CREDENTIALS_FILE name"
_ODD = "is there a proxy, or a page to sign in at, in between?"
# A store that is not there shall be told within seconds; one that has answered before may be slow.
_FIRST_ANSWER_S = 8.0
_ANSWER_S = 20.0
# Whatever dribbles in more slowly than this is cut, however long: a download goes on from what has arrived.
_PATIENCE_S, _SLOWEST_BYTES_PER_S = 30.0, 4096
_BLOCK_BYTES = 1 << 18
_AFTER_THE_END = "InvalidRange"
_OF_AN_OBJECT = frozenset({"ETag", "LastModified", "ContentLength"})
# What every server says: a page to sign in at, which answers 200 to anything, does not.
_SAID: Mapping[str, frozenset[str]] = {
    "head_object": _OF_AN_OBJECT,
    "get_object": _OF_AN_OBJECT,
    "put_object": frozenset({"ETag"}),
    "delete_object": frozenset(),
    "list_objects_v2": frozenset({"Name"}),
    "list_multipart_uploads": frozenset({"Bucket"}),
}
_BODILESS = frozenset({"put_object", "delete_object"})
_OK, _NO_CONTENT, _PART = 200, 204, 206
_STATUSES: Mapping[str, int] = {"delete_object": _NO_CONTENT}


class _Answered(Protocol):
    response: Mapping[str, Mapping[str, object]]


class OddAnswer(Exception):  # noqa: N818 - a state
    """What answered is no S3 server, or somebody in between has cut what it said."""


# The status and code that the server sent decide, wherever they are in the chain of exceptions; botocore's own errors
# are no OSErrors (docs/reference/store.md, section 5). Messages carry neither the server's text nor credentials. Of
# whatever else comes of a request, as when botocore reads what is no answer of S3, the store was not reached.
def s3_error(exc: Exception, url: str, key: str) -> StoreError:
    """Returns the store's error for what came up while working on the key.

    Args:
        exc: What was raised.
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
        return kind(f"{place}: {exc.strerror or exc}{f': {exc.filename}' if exc.filename else ''}")
    if isinstance(exc, BotoCoreError) and not isinstance(exc, _NO_ANSWER):
        return StoreUnreachable(f"{place}: this machine's settings for AWS are wrong: {exc}; {_SETTINGS}")
    return _silence(exc, place)


def _silence(exc: Exception, place: str) -> StoreAway:
    if isinstance(exc, ProxyConnectionError):
        return StoreAway(
            f"{place}: the proxy that HTTP_PROXY or HTTPS_PROXY names does not answer; NO_PROXY says for whom"
        )
    said = str(exc) if isinstance(exc, OddAnswer) else type(exc).__name__
    if isinstance(exc, FAULTS):
        return StoreAway(f"{place}: no answer from {_endpoint()} ({said}); is it running and reachable?")
    return StoreAway(f"{place}: {_endpoint()} does not answer as S3 does: {said}; {_ODD}")


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
    name, url = chosen_endpoint()
    host = urlsplit(url).netloc.rpartition("@")[2]
    return f"{host} ({name})" if name else "Amazon S3"


def _require_endpoint(url: str) -> None:
    """Refuses a server's URL that leads nowhere; no URL means Amazon's."""
    try:
        parts = urlsplit(url)
        leads = parts.scheme in {"http", "https"} and parts.hostname and parts.port != 0
    except ValueError:  # a port that is no number, a bracket too many
        leads = False
    if url and not leads:
        name = chosen_endpoint()[0] or "the endpoint"
        raise InvalidConfigError(error_msg=f"{name} is {url!r}, and no URL such as http://127.0.0.1:9000")


Answer = Mapping[str, object]


class _Body(Protocol):
    def read(self, amt: int | None = None) -> bytes: ...

    def close(self) -> None: ...


# Endpoint, region and credentials come from the usual AWS variables and profiles. Conditions on writes are no part of
# fsspec's interface, so that objects go through botocore itself, and a robot's agent stays small; what is big goes
# through fsspec's s3fs (tasks.storage.backends.s3_upload).
class S3Client:
    """Calls to one server, from any thread."""

    def __init__(self, access: S3Access | None = None) -> None:
        self._access = access or S3Access()
        self._making = threading.Lock()
        self._session: Session | None = None
        self._client: object = None
        self._has_answered = False

    def call(self, operation: str, **parameters: object) -> Answer:
        """Returns the server's answer to an operation of botocore's S3 client.

        Raises:
            OddAnswer: It is none of S3's.
            Exception: botocore's, or what its parsers meet in what is none of S3's.
        """
        try:
            answer = cast("Answer", getattr(self._ready(), operation)(**parameters))
        except (BotoCoreError, ClientError) as exc:
            if hasattr(exc, "response"):
                self._answered()
            raise
        _require_said(operation, answer, part="Range" in parameters)
        self._answered()
        return answer

    def put(self, bucket: str, key: str, body: bytes, **parameters: object) -> str:
        """Writes an object whole, and returns its etag; raises what `call` does.

        A server that gets the headers of a sender that is killed then may take that for an empty object
        (docs/reference/store.md, section 12), so that the bytes' MD5 goes along.

        Args:
            bucket: Where it goes.
            key: What it is called there.
            body: Its bytes.
            parameters: More of what PutObject takes, such as a condition.
        """
        digest = base64.b64encode(hashlib.md5(body, usedforsecurity=False).digest()).decode()
        return str(self.call("put_object", Bucket=bucket, Key=key, Body=body, ContentMD5=digest, **parameters)["ETag"])

    def read(self, bucket: str, key: str, most_bytes: int) -> tuple[bytes, str]:
        """Returns an object's bytes, or the first of them, and its etag from one answer, so that they belong together.

        Args:
            bucket: Where it is.
            key: What it is called there.
            most_bytes: So many are read, and not one more.
        """
        answer = self.call("get_object", Bucket=bucket, Key=key)
        body, length = cast("_Body", answer["Body"]), cast("int", answer["ContentLength"])
        try:
            found = body.read(most_bytes)
        finally:
            body.close()
        if len(found) < min(most_bytes, length):  # or the first half of an object would pass for all of it
            raise OddAnswer(f"with {len(found)} of {length} bytes")
        return found, str(answer["ETag"])

    def blocks(self, bucket: str, key: str, first_byte: int) -> Generator[bytes]:
        """Yields an object's bytes from one of them on, as they arrive."""
        asked = {"Range": f"bytes={first_byte}-"} if first_byte else {}
        try:
            answer = self.call("get_object", Bucket=bucket, Key=key, **asked)
        except ClientError as exc:
            if exc.response.get("Error", {}).get("Code") == _AFTER_THE_END:
                return
            raise
        body = cast("_Body", answer["Body"])
        unasked = 0 if "ContentRange" in answer else first_byte  # a server may send all of it
        try:
            while block := body.read(_BLOCK_BYTES):
                yield block[unasked:]
                unasked = max(0, unasked - len(block))
        finally:
            body.close()

    def send(self, source: Path, bucket: str, key: str) -> None:
        """Writes the file's bytes as an object, in parts when it is big; it shows when the last part has arrived."""
        if source.stat().st_size <= PART_BYTES:
            self.put(bucket, key, source.read_bytes())
            return
        from tasks.storage.backends.s3_upload import send_in_parts  # noqa: PLC0415 - a robot's agent has nothing big to send

        send_in_parts(source, bucket, key, self._access)

    def _ready(self) -> object:
        with self._making:
            if self._client is None:
                try:
                    self._client = self._made(_FIRST_ANSWER_S, attempts=2)
                except ValueError as exc:  # of botocore's, which reads numbers and addresses in variables
                    raise InvalidConfigError(error_msg=str(exc)) from exc
            return self._client

    def _answered(self) -> None:
        with self._making:
            if not self._has_answered:
                self._has_answered, self._client = True, self._made(_ANSWER_S, attempts=3)

    def _made(self, answer_s: float, attempts: int) -> object:
        endpoint = self._access.endpoint or chosen_endpoint()[1]
        _require_endpoint(endpoint)
        if self._session is None:
            self._session = Session()
            self._session.register_component("data_loader", _service_models())
        retries = {"mode": "standard", "total_max_attempts": attempts}
        config = Config(**CONFIG, **past_proxies(endpoint), read_timeout=answer_s, retries=retries)  # pyright: ignore[reportArgumentType] - untyped options
        client = self._session.create_client(
            "s3",
            config=config,
            aws_access_key_id=self._access.key_id or None,
            aws_secret_access_key=self._access.secret or None,
            aws_session_token=self._access.token or None,
            region_name=self._access.region or None,
            endpoint_url=self._access.endpoint or None,
        )
        return _paced(client)


def _paced(client: Any) -> object:  # noqa: ANN401 - botocore makes its class
    """Returns a client of botocore's whose answers come at a pace, or are cut.

    botocore has no limit for a whole answer, and none at all for the head that answers "Expect: 100-continue", which it
    reads for ever if the connection ends in it; so a body goes with its request.
    """
    client.meta.events.unregister("before-call.s3", add_expect_header)
    # botocore leaves no other way to choose them.
    client._endpoint.http_session._pool_classes_by_scheme.update(http=_PacedPool, https=_PacedTlsPool)  # noqa: SLF001
    return cast("object", client)


class _PacedInput(io.RawIOBase):
    """What arrives on a connection; none of it may come later than its pace demands.

    Args:
        connection: Whose timeout is the limit for a single wait.
        source: Reads from it.
    """

    def __init__(self, connection: socket.socket, source: io.RawIOBase) -> None:
        super().__init__()
        self._connection, self._source = connection, source
        self._wait_s = connection.gettimeout() or _PATIENCE_S
        self._until_s = time.monotonic() + _PATIENCE_S

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any, /) -> int | None:  # noqa: ANN401 - as the base class has it
        left_s = self._until_s - time.monotonic()
        if left_s <= 0:
            raise TimeoutError(f"less than {_SLOWEST_BYTES_PER_S} bytes a second after {_PATIENCE_S:g} s")
        self._connection.settimeout(min(self._wait_s, left_s))
        count = self._source.readinto(buffer)
        self._until_s += (count or 0) / _SLOWEST_BYTES_PER_S
        return count

    def close(self) -> None:
        self._source.close()
        super().close()


class _PacedResponse(HTTPResponse):
    def __init__(self, sock: socket.socket, *given: Any, **options: Any) -> None:  # noqa: ANN401 - handed on
        super().__init__(sock, *given, **options)
        self.fp = io.BufferedReader(_PacedInput(sock, self.fp.detach()))


class _PacedConnection(AWSHTTPConnection):
    response_class = _PacedResponse


class _PacedTlsConnection(AWSHTTPSConnection):
    response_class = _PacedResponse


class _PacedPool(AWSHTTPConnectionPool):
    ConnectionCls = _PacedConnection


class _PacedTlsPool(AWSHTTPSConnectionPool):
    ConnectionCls = _PacedTlsConnection


def _require_said(operation: str, answer: Answer, *, part: bool) -> None:
    """Does nothing for an answer that a server of S3 may give to an operation.

    Args:
        operation: Of botocore's client.
        answer: What botocore made of what came.
        part: Whether a part of an object was asked for.

    Raises:
        OddAnswer: It is another one.
    """
    if operation not in _SAID:
        return
    if missing := _SAID[operation] - answer.keys():
        raise OddAnswer(f"without {', '.join(sorted(missing))}")
    http = cast("Mapping[str, object]", answer["ResponseMetadata"])
    if http["HTTPStatusCode"] not in {_OK, _PART if part else _STATUSES.get(operation, _OK)}:
        raise OddAnswer(f"with status {http['HTTPStatusCode']}")
    length = cast("int", answer.get("ContentLength", 0))
    sent = int(cast("Mapping[str, str]", http["HTTPHeaders"]).get("content-length", "0"))
    if length < 0 or (operation in _BODILESS and sent):
        raise OddAnswer(f"with {length or sent} bytes")


@functools.cache
def _service_models() -> Loader:
    """Returns botocore's descriptions of services: megabytes of JSON, which each store's session would parse anew."""
    return create_loader()


def is_etag_of(etag: str, file: Path, part_bytes: int) -> bool:
    """Returns whether an etag is that of the file's bytes; False also if it is of a kind that says nothing.

    Args:
        etag: As the server gives it, with or without quotes.
        file: What was sent.
        part_bytes: Size of the parts if it was sent in parts.
    """
    digest, _, parts = etag.strip('"').partition("-")
    if not parts:
        with file.open("rb") as sent:
            return digest == hashlib.file_digest(sent, lambda: hashlib.md5(usedforsecurity=False)).hexdigest()
    together = hashlib.md5(usedforsecurity=False)
    count = 0
    with file.open("rb") as sent:
        while part := sent.read(part_bytes):
            together.update(hashlib.md5(part, usedforsecurity=False).digest())
            count += 1
    return (digest, parts) == (together.hexdigest(), str(count))
