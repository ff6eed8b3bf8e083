"""One connection to an S3 server, as s3fs opens it: the only place that knows the client's parameters.

Endpoint, region and credentials come from the usual AWS variables and profiles.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import BinaryIO, TypeVar, cast

from fsspec.asyn import sync
from s3fs import S3FileSystem

from tasks.storage.s3_errors import FAULTS

Result = TypeVar("Result")
Answer = Mapping[str, object]
# A store that is not there shall be told within seconds; one that has answered before may be slow.
_FIRST_ANSWER_S = 12.0
_ANSWER_S = 60.0
PART_BYTES = 16 << 20
_CONFIG: Mapping[str, object] = {
    "connect_timeout": 2,
    "read_timeout": 30,
    "retries": {"mode": "standard", "total_max_attempts": 3},
    # Newer checksums are refused by older servers; ETags and TLS protect what is sent.
    "request_checksum_calculation": "when_required",
    "response_checksum_validation": "when_required",
}


class _ExactKeys(S3FileSystem):
    """Takes every key as it is: s3fs would cut off ``?versionId=`` and write over another object."""

    def split_path(self, path: str) -> tuple[str, str, None]:
        """Returns the bucket and the key of ``<bucket>/<key>``."""
        bucket, _, key = path.partition("/")
        return bucket, key, None


class S3Client:
    """Calls to one server, from any thread."""

    def __init__(self) -> None:
        # Shared instances and cached listings would show what was, not what is (fleet.md, trap 6).
        self._files = _ExactKeys(
            skip_instance_cache=True, use_listings_cache=False, max_concurrency=4, config_kwargs=dict(_CONFIG)
        )
        self._files.retries = 1  # botocore retries already
        self._has_answered = False

    def call(self, operation: str, **parameters: object) -> Answer:
        """Returns the server's answer to an operation of botocore's S3 client; raises one of FAULTS."""

        async def ask() -> Answer:
            client = await self._files.set_session()
            return await getattr(client, operation)(**parameters)

        return self._run(ask)

    def read(self, bucket: str, key: str) -> tuple[bytes, str]:
        """Returns an object's bytes and etag from one answer, so that they belong together."""

        async def ask() -> tuple[bytes, str]:
            client = await self._files.set_session()
            answer = await client.get_object(Bucket=bucket, Key=key)
            async with answer["Body"] as body:
                return await body.read(), str(answer["ETag"])

        return self._run(ask)

    def stream(self, bucket: str, key: str, file: BinaryIO) -> None:
        """Writes an object's bytes to the open file."""

        async def ask() -> None:
            client = await self._files.set_session()
            answer = await client.get_object(Bucket=bucket, Key=key)
            async with answer["Body"] as body:
                while chunk := await body.read(1 << 20):
                    file.write(chunk)

        sync(self._files.loop, ask)

    def send(self, source: Path, bucket: str, key: str) -> None:
        """Writes the file's bytes as an object, in parts when it is big; it shows when the last part has arrived."""
        self._files.put_file(str(source), f"{bucket}/{key}", chunksize=PART_BYTES)

    def _run(self, ask: Callable[[], Awaitable[Result]]) -> Result:
        limit_s = _ANSWER_S if self._has_answered else _FIRST_ANSWER_S

        async def bounded() -> Result:
            return await asyncio.wait_for(ask(), limit_s)

        try:
            result = cast("Result", sync(self._files.loop, bounded))
        except FAULTS as exc:
            self._has_answered = self._has_answered or hasattr(exc, "response")
            raise
        self._has_answered = True
        return result
