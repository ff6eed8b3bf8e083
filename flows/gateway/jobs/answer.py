"""Answers about jobs: the fields that a call's shape has, and no paths of this machine in them."""

from collections.abc import Mapping
from typing import TypeVar, cast

from pydantic import JsonValue

from specs.arn import parse_reference
from specs.base import Spec
from specs.digest import canonical_document
from tasks.gateway.places import without_places
from tasks.storage.base.store import Store
from tasks.storage.tags import tags_of

T = TypeVar("T", bound=Spec)
_REASON = "failureReason"


def answer_of(shape: type[T], described: Spec, store: Store) -> T:
    """Returns what a call answers of a job: those fields of its description that the call's shape has.

    Its tags are those that it has now: what somebody gave it later counts, and its outcome is never theirs to change.

    Args:
        shape: The call's answer.
        described: What the Describe call of the job's kind answers.
        store: Where the job is; its place need not be known to clients.
    """
    document = canonical_document(described)
    if "tags" in shape.model_fields:
        said = cast("Mapping[str, str] | None", document.get("tags"))
        document["tags"] = cast("JsonValue", tags_of(store, parse_reference(str(document["arn"])), said))
    fields: dict[str, JsonValue] = {name: document[name] for name in document if name in shape.model_fields}
    return shape.model_validate(placeless(fields, store))


def placeless(document: Mapping[str, JsonValue], store: Store) -> dict[str, JsonValue]:
    """Returns a document whose failure reasons say "the store" where they have the place of the store."""
    return {name: _placeless(value, store, name) for name, value in document.items()}


def _placeless(value: JsonValue, store: Store, name: str) -> JsonValue:
    if isinstance(value, dict):
        return placeless(value, store)
    if isinstance(value, list):
        return [_placeless(each, store, name) for each in value]
    return without_places(value, store.url) if isinstance(value, str) and name == _REASON else value
