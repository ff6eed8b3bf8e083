"""The bucket that a job's output goes to: looked for before the job is recorded."""

from specs.base import Fault
from specs.errors import BucketNotFound, DocumentError, StoreAccessDenied
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket


def require_output(store: Store, bucket: str | None, member: str) -> None:
    """Does nothing if a bucket is there.

    Args:
        store: Where it lies, if nothing else says so.
        bucket: Its name; None if the request has none.
        member: Where the request names it.

    Raises:
        DocumentError: The request names none, or there is none, or the credentials do not reach it.
        StoreError: Nothing answers.
    """
    if bucket is None:
        raise DocumentError([Fault(path=member, value="none", allowed="the name of a bucket")], "request")
    try:
        open_bucket(store, bucket)
    except BucketNotFound as exc:
        allowed = "a bucket that exists; SIMYARD_BUCKETS of the gateway says where buckets lie"
        raise DocumentError([Fault(path=member, value=repr(bucket), allowed=allowed)], "request") from exc
    except StoreAccessDenied as exc:
        allowed = "a bucket that the gateway's credentials reach"
        raise DocumentError([Fault(path=member, value=repr(bucket), allowed=allowed)], "request") from exc
