"""Files too big for one request, through fsspec's s3fs: in parts, several at a time, made one by the last request."""

from pathlib import Path

from aiohttp import ClientError
from s3fs import S3FileSystem

from tasks.storage.backends.s3_access import CONFIG, PART_BYTES, S3Access, chosen_endpoint, past_proxies

_READ_TIMEOUT_S = 30


class _ExactKeys(S3FileSystem):
    """Takes every key as it is: s3fs would cut off ``?versionId=`` and write over another object."""

    def split_path(self, path: str) -> tuple[str, str, None]:
        """Returns the bucket and the key of ``<bucket>/<key>``."""
        bucket, _, key = path.partition("/")
        return bucket, key, None


def send_in_parts(source: Path, bucket: str, key: str, access: S3Access) -> None:
    """Writes a file's bytes as an object; nothing shows before the last part has arrived.

    Raises:
        ConnectionError: The connection was cut.
        OSError: What s3fs makes of the server's refusal, which is its cause.
    """
    retries = {"mode": "standard", "total_max_attempts": 3}
    # Shared instances and cached listings would show what was, not what is (docs/reference/store.md, section 6).
    files = _ExactKeys(
        skip_instance_cache=True,
        use_listings_cache=False,
        max_concurrency=4,
        key=access.key_id or None,
        secret=access.secret or None,
        token=access.token or None,
        endpoint_url=access.endpoint or None,
        client_kwargs={"region_name": access.region} if access.region else {},
        config_kwargs={
            **CONFIG,
            **past_proxies(access.endpoint or chosen_endpoint()[1]),
            "read_timeout": _READ_TIMEOUT_S,
            "retries": retries,
        },
    )
    files.retries = 1  # botocore retries already
    try:
        files.put_file(str(source), f"{bucket}/{key}", chunksize=PART_BYTES)
    except ClientError as exc:
        raise ConnectionError(str(exc)) from exc
