"""Where a document's ``s3Bucket`` lies."""

import os

from specs.base import Fault
from specs.errors import DocumentError, ObjectNotFound, StoreUnreachable
from tasks.storage.keys import STORE, checked_bucket
from tasks.storage.opening import connect
from tasks.storage.store import Store


def bucket_url(store: Store, bucket: str) -> str:
    """Returns the URL of a bucket: behind SIMYARD_BUCKETS (``s3://``, ``file:///data``), else under the store.

    Raises:
        DocumentError: The name is no bucket's, or SIMYARD_BUCKETS no URL.
    """
    root = os.environ.get("SIMYARD_BUCKETS") or f"{store.url}/buckets"
    if not root.startswith(("s3://", "file:///")):
        fault = Fault(path="SIMYARD_BUCKETS", value=repr(root), allowed="s3://, s3://bucket/prefix or file:///folder")
        raise DocumentError([fault], source="environment")
    return f"{root if root.endswith('://') else root.rstrip('/') + '/'}{checked_bucket(bucket)}"


def open_bucket(store: Store, bucket: str) -> Store:
    """Returns the bucket as a store of its own, for uploads and downloads; it is not probed.

    Raises:
        DocumentError: The name is no bucket's.
        BucketNotFound: There is no such bucket.
        StoreUnreachable: Nothing answers.
        StoreAccessDenied: The credentials do not reach it.
    """
    opened = connect(bucket_url(store, bucket))
    try:
        opened.get(STORE)  # only the answer to a read tells a missing bucket from a missing object
    except ObjectNotFound:
        return opened
    except StoreUnreachable as exc:
        raise type(exc)(f"bucket {bucket} ({opened.url}): {exc}; SIMYARD_BUCKETS says where buckets lie") from exc
    return opened
