"""Simyard's own documents as the bytes of an object."""

from typing import TypeVar

from pydantic import ValidationError

from specs.base import Spec
from specs.errors import StoreError
from tasks.storage.base.store import Store, Stored

Document = TypeVar("Document", bound=Spec)


def encoded(document: Spec) -> bytes:
    """Returns the document as JSON."""
    return document.model_dump_json().encode()


def decoded(model: type[Document], stored: Stored, store: Store, key: str) -> Document:
    """Returns the document that the object holds.

    Raises:
        StoreError: It holds something else.
    """
    try:
        return model.model_validate_json(stored.body)
    except ValidationError as exc:
        reason = exc.errors(include_url=False)[0]["msg"]
        raise StoreError(f"{store.url}: {key} was not written by this version of Simyard: {reason}") from exc
