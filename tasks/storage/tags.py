"""Tags that a resource was given after it was made: an object of its own, over the tags that its request had.

A job's request never changes, because its digest makes the token idempotent; so what is tagged later lies beside it.
Robots, fleets, applications and named templates have their tags in their records, which change anyway.
"""

from collections.abc import Callable, Collection, Mapping

from specs.arn import Reference, ResourceKind
from specs.base import Fault, Spec
from specs.data.outcomes import is_reserved, with_outcome
from specs.errors import DocumentError, ResourceNotFound
from tasks.storage.base.keys import NAMED_TEMPLATE_PREFIX, tags_key
from tasks.storage.base.store import Store, find_document, update

TAGS_AT_MOST = 50  # docs/reference/robomaker.md, section 9
Tags = Mapping[str, str]
Change = Callable[[Tags], dict[str, str]]
_IN_RECORDS: Collection[ResourceKind] = ("robot", "deployment-fleet", "robot-application", "simulation-application")


class _TagsRecord(Spec):
    """What is kept: all tags of a resource, those of its request too.

    Attributes:
        resource: Its path, as in its ARN.
    """

    kind: ResourceKind
    resource: str
    tags: dict[str, str]


def are_in_record(reference: Reference) -> bool:
    """Returns whether the tags of a resource stand in its own record, so that nothing lies beside it."""
    is_named = reference.kind == "world-template" and reference.path.startswith(NAMED_TEMPLATE_PREFIX)
    return reference.kind in _IN_RECORDS or is_named


def tags_of(store: Store, reference: Reference, said: Tags | None) -> dict[str, str]:
    """Returns the tags of a resource now; the outcome of a job stays among them.

    Args:
        store: Where it is.
        reference: Its kind and path.
        said: The tags that it was made with, or those in its record, and those that Simyard gives it.
    """
    outcome = {key: value for key, value in (said or {}).items() if is_reserved(key)}
    found = None if are_in_record(reference) else find_document(store, _key(reference), _TagsRecord)
    return with_outcome(found.tags if found else said or {}, outcome)


def change_tags(store: Store, reference: Reference, born: Callable[[], Tags], change: Change) -> None:
    """Changes the tags of a resource that has none in its record, over exactly what was read.

    Args:
        store: Where it is.
        reference: Its kind and path.
        born: Returns the tags that it was made with; raises ResourceNotFound when it is gone.
        change: Returns the tags after the change; called again when another process was first.

    Raises:
        ResourceNotFound: There is no such resource.
        DocumentError: The change gives it more tags than a resource may have.
    """
    key = _key(reference)

    def step(found: _TagsRecord | None) -> _TagsRecord:
        made = born()
        tags = change(found.tags if found else made)
        return _TagsRecord(kind=_kind(reference), resource=reference.path, tags=tags)

    update(store, key, _TagsRecord, step)
    try:
        born()  # who deletes a resource deletes its tags afterwards: one of the two sees the other
    except ResourceNotFound:
        store.delete(key)
        raise


def delete_tags(store: Store, reference: Reference) -> None:
    """Removes the tags that lie beside a resource, after the resource itself is gone."""
    store.delete(_key(reference))


def with_tags(new: Tags, most: int = TAGS_AT_MOST) -> Change:
    """Returns the change that adds tags; one of the same key is overwritten.

    Args:
        new: What is added.
        most: How many the resource may have then; the change refuses more.

    Raises:
        DocumentError: A key is reserved for Simyard.
    """
    require_free_keys(new, "tags")

    def change(tags: Tags) -> dict[str, str]:
        after = {**tags, **new}
        if len(after) > most:
            allowed = f"at most {most} in all; remove some"
            raise DocumentError.of("tags", f"{len(after)} tags", allowed)
        return after

    return change


def without_tags(keys: Collection[str]) -> Change:
    """Returns the change that removes tags; keys that are not there are nothing to it.

    Raises:
        DocumentError: A key is reserved for Simyard.
    """
    require_free_keys(keys, "tagKeys")
    return lambda tags: {key: value for key, value in tags.items() if key not in keys}


def require_free_keys(keys: Collection[str], path: str) -> None:
    """Does nothing for keys of tags that a person may give.

    Args:
        keys: The keys.
        path: Where the request has them, for the error.

    Raises:
        DocumentError: One begins with ``simyard:``.
    """
    allowed = 'a key that does not begin with "simyard:", which is reserved for what Simyard says of a job'
    faults = [Fault(path=path, value=repr(key), allowed=allowed) for key in keys if is_reserved(key)]
    if faults:
        raise DocumentError(faults)


def _key(reference: Reference) -> str:
    return tags_key(_kind(reference), reference.path)


def _kind(reference: Reference) -> ResourceKind:
    if reference.kind is None:
        raise ValueError(f"{reference.path!r} is a plain name; tags belong to a resource of a known kind")
    return reference.kind
