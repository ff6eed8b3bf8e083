"""One connection to an S3 server: the only place that knows the client's parameters.

Endpoint, region and credentials come from the usual AWS variables and profiles. Conditions on writes are no part of
fsspec's interface, so that objects go through botocore itself, and a robot's agent stays below 80 MB; what is big goes
through fsspec's s3fs (tasks.storage.backends.s3_upload).

What S3 calls an object's etag: MD5 of its bytes, or of the MD5s of the parts it was sent in.

Amazon S3 user guide, "Checking object integrity"; objects under a key of KMS have etags of another kind.
"""

import base64
import functools
import hashlib
import threading
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Protocol, cast

from botocore.config import Config
from botocore.exceptions import ClientError
from botocore.loaders import Loader, create_loader
from botocore.session import Session

from tasks.storage.backends.s3_access import S3Access
from tasks.storage.backends.s3_errors import FAULTS

Answer = Mapping[str, object]
# A store that is not there shall be told within seconds; one that has answered before may be slow.
_FIRST_ANSWER_S = 8.0
_ANSWER_S = 20.0
PART_BYTES = 16 << 20
_BLOCK_BYTES = 1 << 18
_AFTER_THE_END = "InvalidRange"
CONFIG: Mapping[str, object] = {
    "connect_timeout": 2,
    "max_pool_connections": 32,
    # Newer checksums are refused by older servers; ETags and TLS protect what is sent.
    "request_checksum_calculation": "when_required",
    "response_checksum_validation": "when_required",
}


class _Body(Protocol):
    def read(self, amt: int | None = None) -> bytes: ...

    def close(self) -> None: ...


class S3Client:
    """Calls to one server, from any thread."""

    def __init__(self, access: S3Access | None = None) -> None:
        self._access = access or S3Access()
        self._making = threading.Lock()
        self._session: Session | None = None
        self._client: object = None
        self._has_answered = False

    def call(self, operation: str, **parameters: object) -> Answer:
        """Returns the server's answer to an operation of botocore's S3 client; raises one of FAULTS."""
        try:
            answer = cast("Answer", getattr(self._ready(), operation)(**parameters))
        except FAULTS as exc:
            if hasattr(exc, "response"):
                self._answered()
            raise
        self._answered()
        return answer

    def put(self, bucket: str, key: str, body: bytes, **parameters: object) -> str:
        """Writes an object whole, and returns its etag; raises one of FAULTS.

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
        body = cast("_Body", answer["Body"])
        try:
            return body.read(most_bytes), str(answer["ETag"])
        finally:
            body.close()

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
                self._client = self._made(_FIRST_ANSWER_S, attempts=2)
            return self._client

    def _answered(self) -> None:
        with self._making:
            if not self._has_answered:
                self._has_answered, self._client = True, self._made(_ANSWER_S, attempts=3)

    def _made(self, answer_s: float, attempts: int) -> object:
        if self._session is None:
            self._session = Session()
            self._session.register_component("data_loader", _service_models())
        retries = {"mode": "standard", "total_max_attempts": attempts}
        config = Config(**CONFIG, read_timeout=answer_s, retries=retries)  # pyright: ignore[reportArgumentType] - untyped options
        return cast(
            "object",
            self._session.create_client(
                "s3",
                config=config,
                aws_access_key_id=self._access.key_id or None,
                aws_secret_access_key=self._access.secret or None,
                aws_session_token=self._access.token or None,
                region_name=self._access.region or None,
                endpoint_url=self._access.endpoint or None,
            ),
        )


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
