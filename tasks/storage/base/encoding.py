"""Simyard's own documents as the bytes of an object, and objects that are written once."""

from typing import TypeVar

from pydantic import ValidationError

from specs.base import Spec
from specs.errors import ObjectExists, ObjectStrange
from tasks.storage.base.store import Store, StoredObject

Document = TypeVar("Document", bound=Spec)


def encode_document(document: Spec) -> bytes:
    """Returns the document as JSON."""
    return document.model_dump_json().encode()


def decode_document(model: type[Document], stored: StoredObject, store: Store, key: str) -> Document:
    """Returns the document that the object holds.

    Args:
        model: What the object must be.
        stored: The object.
        store: Where it is, for the error.
        key: Its key, for the error.

    Raises:
        ObjectStrange: It holds something else.
    """
    try:
        return model.model_validate_json(stored.body)
    except ValidationError as exc:
        reason = exc.errors(include_url=False)[0]["msg"]
        raise ObjectStrange(f"{store.url}: {key} was not written by this version of Simyard: {reason}") from exc


def create_once(store: Store, key: str, body: bytes) -> None:
    """Creates an object, or finds it there with the same bytes.

    Raises:
        ObjectExists: It is there with other bytes.
    """
    try:
        store.create(key, body)
    except ObjectExists as exc:
        if store.get(key).body != body:
            reason = f"{store.url}: {key} holds something else than this version of Simyard makes"
            raise ObjectExists(reason) from exc
