"""How a bucket is reached. Credentials that do not come from the environment are kept in this process alone.

A program that this process starts does not get them: an application, a robot of a demonstration, a worker of a cluster.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from tasks.storage.base.proxies import is_local

CONFIG: Mapping[str, object] = {
    "connect_timeout": 2,
    "max_pool_connections": 32,
    # Newer checksums are refused by older servers; ETags and TLS protect what is sent.
    "request_checksum_calculation": "when_required",
    "response_checksum_validation": "when_required",
}
"""What botocore is told of every connection to a server."""
_ENDPOINTS = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL")
PART_BYTES = 16 << 20
"""A bigger file is sent in parts of so many."""


@dataclass(frozen=True)
class S3Access:
    """How to reach a bucket; what is empty comes from the usual AWS variables and profiles.

    Attributes:
        key_id: AWS access key ID.
        secret: AWS secret access key.
        token: Session token, of temporary credentials.
        region: Such as ``eu-central-1``.
        endpoint: URL of the server, if it is not AWS's.
    """

    key_id: str = ""
    secret: str = field(default="", repr=False)
    token: str = field(default="", repr=False)
    region: str = ""
    endpoint: str = ""


_ENVIRONMENT = S3Access()
_of_bucket: dict[str, S3Access] = {}


def give_access(bucket: str, access: S3Access) -> None:
    """Has every store in the bucket that this process opens from now on use these credentials."""
    _of_bucket[bucket] = access


def access_to(bucket: str) -> S3Access:
    """Returns how to reach a bucket."""
    return _of_bucket.get(bucket, _ENVIRONMENT)


def chosen_endpoint() -> tuple[str, str]:
    """Returns the variable that names the server, and its URL; two empty texts where none does."""
    return next(((name, os.environ[name]) for name in _ENDPOINTS if os.environ.get(name)), ("", ""))


def past_proxies(endpoint: str) -> dict[str, object]:
    """Returns what botocore is told so that no proxy stands before a server of this machine."""
    return {"proxies": {}} if is_local(endpoint) else {}


def share_access(store_url: str, bucket_url: str) -> None:
    """Has a document's bucket use the credentials of the store, unless it has its own."""
    store, bucket = urlsplit(store_url), urlsplit(bucket_url)
    if store.scheme == bucket.scheme == "s3" and store.netloc in _of_bucket:
        _of_bucket.setdefault(bucket.netloc, _of_bucket[store.netloc])
