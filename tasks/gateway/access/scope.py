"""The part of a store that a key is limited to: resources by name, or by how their names begin."""

from dataclasses import dataclass

from specs.arn import KINDS, ResourceKind, parse_reference
from specs.base import Fault
from specs.errors import DocumentError

_ALLOWED = "an ARN, or KIND/NAME such as deployment-fleet/home; a * at its end stands for every name that begins so"


@dataclass(frozen=True)
class Scope:
    """Some resources of one kind.

    Attributes:
        text: As the owner wrote it.
        kind: Of the resources.
        path: Their name, or how it begins.
        open: Whether names may go on behind that.
        store_id: The store that they are in; empty for whichever the gateway serves.
    """

    text: str
    kind: ResourceKind
    path: str
    open: bool
    store_id: str

    def covers(self, kind: ResourceKind, path: str, store_id: str) -> bool:
        """Returns whether a resource of the store with that id is among them."""
        if kind != self.kind or self.store_id not in {"", store_id}:
            return False
        return path.startswith(self.path) if self.open else path == self.path

    def covers_all(self, kind: ResourceKind, store_id: str) -> bool:
        """Returns whether every resource of a kind is among them, also those that are yet to be made."""
        return self.open and not self.path and self.covers(kind, "", store_id)


def parse_scope(text: str) -> Scope:
    """Returns the resources that a text names.

    Raises:
        DocumentError: It is neither an ARN nor KIND/NAME, or a * is not at its end.
    """
    named = text.removesuffix("*")
    if "*" in named or any(char.isspace() for char in named):
        raise _refused(text)
    if not named.startswith("arn:"):
        kind, slash, path = named.partition("/")
        return _scope(text, kind if slash else "", path, "")
    try:
        reference = parse_reference(named)
    except ValueError as exc:
        raise _refused(text) from exc
    own = named.split(":")[3] if named.startswith("arn:simyard:") else ""
    return _scope(text, reference.kind or "", reference.path, own)


def _scope(text: str, kind: str, path: str, store_id: str) -> Scope:
    for known in KINDS:
        if kind == known and (path or text.endswith("*")):
            return Scope(text, known, path, text.endswith("*"), store_id)
    raise _refused(text)


def _refused(text: str) -> DocumentError:
    return DocumentError([Fault(path="--on", value=repr(text), allowed=_ALLOWED)], source="access key")
