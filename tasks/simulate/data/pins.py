"""Pins the data sources of a batch: fetches their files once, and notes their digests, or why they cannot be used.

Nothing here refuses a document: a job whose file is missing is a row that says so, and the others run.
"""

from pathlib import Path

from specs.errors import BundleRefused, DocumentError, ObjectNotFound, StoreAccessDenied
from specs.robomaker.simulation import DataSourceConfig
from tasks.simulate.data.content_cache import DataCache
from tasks.simulate.data.sources import MOST_BYTES, MOST_FILES, DataFailure, PinnedFile, PinnedSource, unpinned
from tasks.simulate.data.unpack import ENDINGS
from tasks.storage.archives import safe_parts
from tasks.storage.base.key_rules import checked_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket


class _Unusable(Exception):  # noqa: N818 - a state
    def __init__(self, code: DataFailure, why: str) -> None:
        self.code: DataFailure = code
        super().__init__(why)


def pin_source(store: Store, cache: Path, source: DataSourceConfig) -> PinnedSource:
    """Returns a data source with the digests of its files, which are in the cache then; a failed one says why.

    Args:
        store: What the bucket's place follows from.
        cache: Folder of fetched files.
        source: As the request has it.

    Raises:
        StoreError: The bucket is not there, does not answer, or fails: that passes, and would be no job's fault.
    """
    found = unpinned(source)
    try:
        bucket = open_bucket(store, source.s3Bucket)
        safe_parts(found.destination)
        keys = _keys(bucket, source)
        return found.model_copy(update={"files": tuple(_files(bucket, source.s3Bucket, DataCache(cache), keys))})
    except _Unusable as exc:
        return found.failed(exc.code, str(exc))
    except StoreAccessDenied:
        return found.failed("BadPermissionsS3Object", f"bucket {source.s3Bucket} refuses to be read")
    except BundleRefused:
        return found.failed("InvalidInput", f"{source.destination!r} is no folder below a job's own")


def _files(bucket: Store, name: str, cache: DataCache, keys: list[str]) -> list[PinnedFile]:
    if len(keys) > MOST_FILES:
        raise _Unusable("LimitExceeded", f"{len(keys)} files; at most {MOST_FILES}")
    files: list[PinnedFile] = []
    for key in keys:
        _require_safe(key)
        try:
            files.append(cache.fetched(bucket, key))
        except ObjectNotFound as exc:  # its text names places of this machine, and a row must not
            raise _Unusable("InvalidS3Resource", f"there is no {name}/{key}") from exc
        if sum(file.size_bytes for file in files) > MOST_BYTES:
            raise _Unusable("LimitExceeded", f"more than {MOST_BYTES:,} bytes")
    return files


def _keys(bucket: Store, source: DataSourceConfig) -> list[str]:
    if source.type == "Prefix":
        found = [key for prefix in source.s3Keys for key in _below(bucket, prefix)]
        if not found:
            places = ", ".join(f"{source.s3Bucket}/{prefix}" for prefix in source.s3Keys)
            raise _Unusable("InvalidS3Resource", f"there is nothing below {places}")
        return list(dict.fromkeys(found))
    if source.type == "Archive":
        others = [key for key in source.s3Keys if not key.endswith(ENDINGS)]
        if others:
            raise _Unusable("InvalidInput", f"{others[0]!r} is no {' or '.join(ENDINGS)} file")
    return list(dict.fromkeys(source.s3Keys))


def _below(bucket: Store, prefix: str) -> list[str]:
    """Returns the keys that begin with a prefix, which need not be a whole folder's name."""
    folder, _, _ = prefix.rpartition("/")
    if folder:
        _require_safe(folder)
    return [key for key in bucket.keys(folder) if key.startswith(prefix)]


def _require_safe(key: str) -> None:
    try:
        safe_parts(checked_key(key))
    except (BundleRefused, DocumentError) as exc:
        raise _Unusable("InvalidInput", f"{key!r} is no relative path") from exc
