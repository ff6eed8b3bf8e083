"""The buckets of documents: where each lies, and whether an application's sources in one are unchanged.

RoboMaker keeps no copy of a bundle, so a source that changes breaks the versions that were made from it
(docs/reference/robomaker.md, section 9). Here the copy is in the store and would still run; but who rebuilds in place
believes that the new bytes are what is deployed.
"""

import os

from specs.base import Fault
from specs.errors import DocumentError, ObjectNotFound, ObjectTooBig, StoreUnreachable
from specs.robomaker.bundle import Version
from tasks.storage.backends.s3_access import share_access
from tasks.storage.base.keys import STORE, checked_bucket
from tasks.storage.base.store import Store
from tasks.storage.store_url import connect


def bucket_url(store: Store, bucket: str) -> str:
    """Returns the URL of a bucket: behind SIMYARD_BUCKETS (``s3://``, ``file:///data``), else under the store.

    Raises:
        DocumentError: The name is no bucket's, or SIMYARD_BUCKETS no URL.
    """
    root = os.environ.get("SIMYARD_BUCKETS") or f"{store.url}/buckets"
    if not root.startswith(("s3://", "file:///")):
        raise DocumentError.of(
            "SIMYARD_BUCKETS", repr(root), "s3://, s3://bucket/prefix or file:///folder", source="environment"
        )
    return f"{root if root.endswith('://') else root.rstrip('/') + '/'}{checked_bucket(bucket)}"


def open_bucket(store: Store, bucket: str) -> Store:
    """Returns the bucket as a store of its own, for uploads and downloads; it is not probed.

    Raises:
        DocumentError: The name is no bucket's.
        BucketNotFound: There is no such bucket.
        StoreUnreachable: Nothing answers.
        StoreAccessDenied: The credentials do not reach it.
    """
    url = bucket_url(store, bucket)
    share_access(store.url, url)
    opened = connect(url, store.url if url.startswith(f"{store.url}/") else url.rpartition("/")[0])
    try:
        # Only the answer to a read tells a missing bucket from a missing object; what is there does not matter.
        opened.get(STORE, 0)
    except (ObjectNotFound, ObjectTooBig):
        return opened
    except StoreUnreachable as exc:
        raise type(exc)(f"bucket {bucket} ({opened.url}): {exc}; SIMYARD_BUCKETS says where buckets lie") from exc
    return opened


MISMATCHED = {
    "robot-application": "RobotApplicationVersionMismatchedEtag",
    "simulation-application": "SimulationApplicationVersionMismatchedEtag",
}


def source_faults(store: Store, version: Version, path: str) -> list[Fault]:
    """Returns a fault for each source whose ETag is another than when the version was made.

    Args:
        store: Where the version is.
        version: The version; one that was packed from a folder has no sources that could change.
        path: Where the document names it.

    Raises:
        StoreError: A bucket cannot be asked.
    """
    faults: list[Fault] = []
    for build in version.builds:
        if build.origin and (found := etag_now(store, build.origin.bucket, build.origin.key)) != build.origin.etag:
            place = f"s3://{build.origin.bucket}/{build.origin.key}"
            what = f"{place}, which {f'has ETag {found}' if found else 'is gone'} ({MISMATCHED[version.kind]})"
            allowed = f"ETag {build.origin.etag}, which version {version.number} was made of; make a new version"
            faults.append(Fault(path=path, value=what, allowed=allowed))
    return faults


def etag_now(store: Store, bucket: str, key: str) -> str:
    """Returns the ETag of what lies in a bucket, without quotation marks; empty for nothing.

    Raises:
        StoreError: The bucket cannot be asked.
    """
    try:
        return open_bucket(store, bucket).etag(key).strip('"')
    except ObjectNotFound:
        return ""
