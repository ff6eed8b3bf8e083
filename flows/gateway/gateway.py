"""What every handler of an operation has at hand: the gateway, what a request refers to, how many resources may be.

Commands and documents have no quota: only calls over HTTP.
"""

from collections.abc import Callable, Collection, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Lock
from typing import Any

from specs.arn import KINDS, RUN_KIND, Reference, ResourceKind, absence, parse_reference
from specs.base import Spec
from specs.errors import DocumentError, LimitExceeded, ResourceNotFound
from specs.settings import CountSetting
from tasks.storage.base.keys import checked_name
from tasks.storage.base.store import Store

ROBOMAKER_KINDS: tuple[ResourceKind, ...] = tuple(kind for kind in KINDS if kind != RUN_KIND)
"""All that RoboMaker has: runs of documents are Simyard's own."""
_TWO_PARTS: Collection[ResourceKind] = ("world", "simulation-job")
_LOCKS: dict[CountSetting, Lock] = {}
_TABLE = Lock()


@dataclass(frozen=True)
class Gateway:
    """What every operation has at hand; several requests are answered at once, each in a thread.

    Attributes:
        store: Where everything is.
        wake: Tells the workers of this machine that the queue has something new; those elsewhere look themselves.
    """

    store: Store
    wake: Callable[[], None]


Handler = Callable[[Gateway, Any], Spec]
"""Answers one operation: a request of its shape in, an answer of its shape out; raises specs.errors."""
Handlers = Mapping[str, Handler]


def path_of(store: Store, text: str, kind: ResourceKind, member: str) -> str:
    """Returns the name of the resource in an ARN: its path in the store, whether or not it is there.

    Args:
        store: Where it should be, for the error.
        text: The ARN.
        kind: What it must be of.
        member: What the request calls it, such as ``fleet``.

    Raises:
        DocumentError: It is no ARN, or one of another kind.
        ResourceNotFound: Nothing can be called so.
    """
    return referenced(store, text, (kind,), member).path


# What is no ARN of the kind is an invalid parameter; what is one, and names nothing that could be there, is not
# found.
def referenced(store: Store, text: str, kinds: Collection[ResourceKind], member: str) -> Reference:
    """Returns the kind and the path that an ARN names, whether or not the resource is there.

    Args:
        store: Where it should be, for the error.
        text: The ARN.
        kinds: Those that it may be of.
        member: What the request calls it, such as ``resourceArn``.

    Raises:
        DocumentError: It is no ARN, or one of another kind.
        ResourceNotFound: Nothing can be called so.
    """
    found = _parsed(text, member)
    if found.kind is None or found.kind not in kinds:
        raise _refused(text, member, f"the ARN of a {' or '.join(kinds)}" if len(kinds) < len(KINDS) - 1 else "an ARN")
    parts = found.path.split("/")
    if len(parts) != (2 if found.kind in _TWO_PARTS else 1) or not all(map(_is_name, parts)):
        raise missing(store, text, found.kind, member)
    return found


def missing(store: Store, text: str, kind: ResourceKind, member: str) -> ResourceNotFound:
    """Returns the error that says that there is no such resource."""
    return ResourceNotFound.of(member, repr(text), absence([kind], store.url))


def _parsed(text: str, member: str) -> Reference:
    try:
        return parse_reference(text)
    except ValueError as exc:
        raise _refused(text, member, str(exc)) from exc


def _is_name(part: str) -> bool:
    try:
        checked_name(part)
    except DocumentError:
        return False
    return True


def _refused(text: str, member: str, allowed: str) -> DocumentError:
    return DocumentError.of(member, repr(text), allowed)


# Calls of one gateway that make resources of a kind wait for each other between the count and the creation. So a
# store exceeds a quota by at most one resource for each further gateway that serves it.
@contextmanager
def one_more(quota: CountSetting, count: Callable[[], int]) -> Generator[None]:
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
        most = quota.value()
        if count() >= most:
            allowed = f"at most {most} {quota.what} ({quota.variable}); delete one"
            raise LimitExceeded.of("request", "one more", allowed, source="request")
        yield
