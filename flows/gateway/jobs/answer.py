"""Answers about jobs: the fields that a call's shape has, and no paths of this machine in them."""

import re
from collections.abc import Mapping
from typing import TypeVar, cast

from pydantic import JsonValue

from specs.arn import parse_reference
from specs.base import Spec
from specs.digest import canonical_document
from tasks.storage.base.store import Store
from tasks.storage.tags import tags_of

T = TypeVar("T", bound=Spec)
_REASON = "failureReason"
_FOLDER_URL = re.compile(r"file://[^\s'\";,)]*")


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
    return said_of(store, value) if isinstance(value, str) and name == _REASON else value


def said_of(store: Store, text: str) -> str:
    """Returns a message that says "the store" where it has the place of the store, or of a bucket on this machine."""
    for place in (store.url, store.url.removeprefix("file://")):
        text = text.replace(f"the store {place}", "the store").replace(place, "the store")
    return _FOLDER_URL.sub("the store", text)
