"""What a store promises, whatever holds it, and how a document becomes an object in it."""

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar, overload

from pydantic import ValidationError

from specs.base import Spec
from specs.errors import ObjectConflict, ObjectCorrupt, ObjectExists, ObjectNotFound

UNBOUNDED = 1 << 62


@dataclass(frozen=True)
class StoredObject:
    """An object as it was read: its bytes, and the mark that a compare-and-swap hands back.

    Attributes:
        body: All of the object.
        etag: Changes whenever the bytes do; means nothing outside the store that gave it.
    """

    body: bytes
    etag: str


@dataclass(frozen=True)
class Entry:
    """An object as a listing shows it, or a write that never came to its end.

    Attributes:
        key: The object's; of a write the key that it was for, or the place where its bytes lie.
        size_bytes: How big it is; 0 where the store does not tell.
        written_s: When it was last written, by the clock of the store: to be held against ``Store.now_s`` and other
            entries of the same store, never against the clock of this machine.
        mark: Tells this state of it from every later one that has other bytes, and where the store can, from one that
            was written again with the same bytes.
    """

    key: str
    size_bytes: int
    written_s: float
    mark: str


class Store(Protocol):
    """Objects under keys, written whole or not at all.

    Keys are relative, parts joined by ``/``, no part empty or beginning with a dot (``tasks.storage.base.keys``). Every
    method raises StoreUnreachable, StoreAccessDenied or StoreError when the store cannot do what is asked, and
    DocumentError for a key that is not one.

    Attributes:
        url: ``file:///absolute/path`` or ``s3://bucket/prefix``, without a slash at the end.
    """

    url: str

    def create(self, key: str, body: bytes) -> str:
        """Returns the etag of a new object; of many that create one key at once, exactly one succeeds.

        Raises:
            ObjectExists: The key is taken.
        """
        ...

    def replace(self, key: str, body: bytes, etag: str) -> str:
        """Returns the etag of an object written over the one that was read with that etag.

        Raises:
            ObjectConflict: The object has changed since, or is gone.
        """
        ...

    def put(self, key: str, body: bytes) -> str:
        """Returns the etag of an object written over whatever was there: for objects that have a single writer."""
        ...

    def get(self, key: str, most_bytes: int = UNBOUNDED) -> StoredObject:
        """Returns the object; of a bigger one than somebody reckons with, no more than that is read.

        Raises:
            ObjectNotFound: There is none under the key.
            ObjectTooBig: It has more bytes than that.
        """
        ...

    def size(self, key: str) -> int:
        """Returns how many bytes the object has.

        Raises:
            ObjectNotFound: There is none under the key.
        """
        ...

    def etag(self, key: str) -> str:
        """Returns the object's etag without keeping the object in memory.

        Raises:
            ObjectNotFound: There is none under the key.
        """
        ...

    def blocks(self, key: str, first_byte: int = 0) -> Generator[bytes]:
        """Yields the object's bytes, from the one with that number on, as they arrive.

        Nothing after its end. Whoever stops in between has not read the rest.

        Raises:
            ObjectNotFound: There is none under the key.
        """
        ...

    def exists(self, key: str) -> bool:
        """Returns whether there is an object under the key."""
        ...

    def mark(self, key: str) -> str:
        """Returns what changes whenever the object is written, found without reading it.

        It is no etag, and tells nothing about objects of other keys or stores.

        Raises:
            ObjectNotFound: There is none under the key.
        """
        ...

    def keys(self, prefix: str) -> list[str]:
        """Returns the keys in the folder ``prefix`` and below, sorted; all keys for an empty prefix.

        A listing is for showing to people: what is named in a record is true, what is listed may be late.
        """
        ...

    def delete(self, key: str) -> None:
        """Removes the object if it is there."""
        ...

    def upload(self, key: str, source: Path) -> None:
        """Writes the file's bytes under the key, streamed; readers see the old object or the whole new one.

        Raises:
            StoreDamaged: What arrived is not what was sent; it is removed, so nobody takes it for whole.
        """
        ...

    def sweep(self, key: str) -> None:
        """Removes what uploads of the key that were killed have left where nobody sees it.

        Only for who alone uploads to the key: an upload that is under way would fail.
        """
        ...

    def download(self, key: str, target: Path) -> None:
        """Writes the object's bytes to the file, streamed; the file appears whole or not at all.

        Raises:
            ObjectNotFound: There is none under the key.
        """
        ...

    def entries(self, prefix: str) -> list[Entry]:
        """Returns what ``keys`` returns with size and age, in the same order."""
        ...

    def entry(self, key: str) -> Entry:
        """Returns one object as a listing shows it.

        Raises:
            ObjectNotFound: There is none under the key.
        """
        ...

    def now_s(self) -> float:
        """Returns the time by the clock that writes ``Entry.written_s``, at most a second too early."""
        ...

    def delete_unchanged(self, entry: Entry) -> bool:
        """Removes an object unless it was written since it was listed; returns whether it is gone now.

        A folder does both in one step. An S3 server compares bytes at best: between a look at when it was written
        last and the removal, some milliseconds later, another may write the same bytes again.
        """
        ...

    def unfinished(self, prefix: str) -> list[Entry]:
        """Returns the writes to the folder and below that have not come to their end: dead ones, and live ones too."""
        ...

    def discard(self, write: Entry) -> None:
        """Removes what a write that never came to its end has left; one that is under way would fail."""
        ...


Document = TypeVar("Document", bound=Spec)
_ATTEMPTS, _LONGEST_PAUSE_S = 1000, 0.05


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
        raise ObjectCorrupt(f"{store.url}: {key} was not written by this version of Simyard: {reason}") from exc


def find_document(store: Store, key: str, model: type[Document], most_bytes: int = UNBOUNDED) -> Document | None:
    """Returns the document under a key; None if there is none.

    Raises:
        ObjectCorrupt: There is something else.
        ObjectTooBig: It has more bytes than that.
    """
    try:
        return decode_document(model, store.get(key, most_bytes), store, key)
    except ObjectNotFound:
        return None


@overload
def update(store: Store, key: str, model: type[Document], step: Callable[[Document | None], Document]) -> Document: ...
@overload
def update(
    store: Store, key: str, model: type[Document], step: Callable[[Document | None], Document | None]
) -> Document | None: ...
def update(
    store: Store, key: str, model: type[Document], step: Callable[[Document | None], Document | None]
) -> Document | None:
    """Returns a document after a change, written over exactly what was read.

    Args:
        store: Where it is.
        key: Its key.
        model: What it is.
        step: Returns what it shall be from what it is, None if there is none; the very same, or None, to write nothing.
            Called again when another process was first.

    Raises:
        ObjectCorrupt: There is something else.
        ObjectConflict: Others were first, a thousand times in a row.
    """
    for attempt in range(_ATTEMPTS):
        try:
            stored = store.get(key)
        except ObjectNotFound:
            stored = None
        before = decode_document(model, stored, store, key) if stored else None
        after = step(before)
        if after is None or after is before:
            return before
        body = encode_document(after)
        try:
            store.replace(key, body, stored.etag) if stored else store.create(key, body)
        except (ObjectConflict, ObjectExists):
            time.sleep(min(0.001 * attempt, _LONGEST_PAUSE_S))
        else:
            return after
    raise ObjectConflict(f"{store.url}: {key} changed {_ATTEMPTS} times while it was being changed")


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
