"""What a request refers to: resources of the kind that its call expects, by their ARNs.

What is no ARN of the kind is an invalid parameter; what is one, and names nothing that could be there, is not found.
"""

from collections.abc import Collection

from specs.arn import KINDS, RUN_KIND, Reference, ResourceKind, absence, parse_reference
from specs.base import Fault
from specs.errors import DocumentError, ResourceNotFound
from tasks.storage.base.key_rules import checked_name
from tasks.storage.base.store import Store

ROBOMAKER_KINDS: tuple[ResourceKind, ...] = tuple(kind for kind in KINDS if kind != RUN_KIND)
"""All that RoboMaker has: runs of documents are Simyard's own."""
_TWO_PARTS: Collection[ResourceKind] = ("world", "simulation-job")


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
    return ResourceNotFound([Fault(path=member, value=repr(text), allowed=absence([kind], store.url))])


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
    return DocumentError([Fault(path=member, value=repr(text), allowed=allowed)])
