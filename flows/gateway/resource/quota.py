"""How many resources there may be, for calls over HTTP: commands and documents have no quota.

Calls of one gateway that make resources of a kind wait for each other between the count and the creation. So a store
exceeds a quota by at most one resource for each further gateway that serves it.
"""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from threading import Lock

from specs.arn import ResourceKind, list_name
from specs.base import Fault
from specs.errors import LimitExceeded

_LOCKS: dict[ResourceKind, Lock] = {}
_TABLE = Lock()


@contextmanager
def one_more(
    kind: ResourceKind, count: Callable[[], int], most: int, setting: str, within: str = ""
) -> Generator[None]:
    """Allows one more resource of a kind to be made, and no other until it is.

    Args:
        kind: What is made.
        count: Returns how many there are.
        most: How many there may be.
        setting: The environment variable that says so.
        within: Where they are counted, such as ``the fleet f``; empty for the whole store.

    Raises:
        LimitExceeded: There are so many already.
    """
    with _TABLE:
        lock = _LOCKS.setdefault(kind, Lock())
    with lock:
        if count() >= most:
            allowed = f"at most {most}{f' in {within}' if within else ''}; remove one, or raise {setting}"
            raise LimitExceeded([Fault(path=list_name(kind), value="one more", allowed=allowed)])
        yield
