"""The tags of a resource in what is told of it: those of now, not those that its request had."""

from typing import TypeVar

from specs.arn import Reference, ResourceKind
from specs.base import Spec
from tasks.storage.base.store import Store
from tasks.storage.tags import tags_of

Described = TypeVar("Described", bound=Spec)


def with_tags_now(store: Store, kind: ResourceKind, path: str, described: Described) -> Described:
    """Returns a description with the tags that the resource has now; the outcome of a job stays among them.

    Args:
        store: Where the resource is.
        kind: Its kind.
        path: Its path, as in its ARN.
        described: What is told of it, with the tags of its request or record.
    """
    if "tags" not in type(described).model_fields:
        return described
    now = tags_of(store, Reference(kind=kind, path=path), getattr(described, "tags", None))
    return described.model_copy(update={"tags": now or None})
