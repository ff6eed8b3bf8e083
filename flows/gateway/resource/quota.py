"""How many resources calls over HTTP may make: commands and documents have no quota.

Calls of one gateway that make resources of a kind wait for each other between the count and the creation. So a store
exceeds a quota by at most one resource for each further gateway that serves it.
"""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from threading import Lock

from specs.base import Fault
from specs.errors import LimitExceeded
from specs.interface.quotas import Quota

_LOCKS: dict[Quota, Lock] = {}
_TABLE = Lock()


@contextmanager
def one_more(quota: Quota, count: Callable[[], int]) -> Generator[None]:
    """Allows one more resource to be made, and no other of its kind until it is.

    Args:
        quota: What is made, and how many there may be.
        count: Returns how many there are.

    Raises:
        LimitExceeded: There are so many already.
    """
    with _TABLE:
        lock = _LOCKS.setdefault(quota, Lock())
    with lock:
        most = quota.most()
        if count() >= most:
            allowed = f"at most {most} {quota.what} ({quota.setting}); delete one"
            raise LimitExceeded([Fault(path="request", value="one more", allowed=allowed)], "request")
        yield
