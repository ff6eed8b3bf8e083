"""Opens the store that a URL names, and refuses one that would lose work."""

import os
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated
from urllib.parse import unquote, urlsplit
from uuid import uuid4

from pydantic import Field

from specs.base import Spec
from specs.errors import (
    DocumentError,
    ObjectConflict,
    ObjectExists,
    ObjectNotFound,
    StoreError,
    StoreUnreachable,
    StoreUnsafe,
)
from tasks.storage.backends.local import LocalStore
from tasks.storage.base.keys import STORE, checked_bucket, checked_key
from tasks.storage.base.store import Store, decode_document, encode_document

_URL_RULE = "file:///absolute/folder or s3://bucket/prefix; credentials come from the usual AWS variables, never here"
_LAYOUT = 1
_MOST_BYTES = 1 << 16  # of store.json, which has a hundred
_CREDENTIALS = re.compile(r"//[^/]*@")


class _StoreRecord(Spec):
    """What ``store.json`` holds; that it is there says that the store kept its promises when it was probed.

    Whoever writes to the store chooses its id, which names folders of this machine.
    """

    id: Annotated[str, Field(pattern=r"^[0-9a-f]{12}$")]
    layout: int
    created_at_s: float


def open_store(url: str | None = None) -> Store:
    """Returns the store at the URL, ready for use.

    The first to open a store probes that it honours conditions on writes, and records that; later ones read that
    record, which also shows that the store answers.

    Args:
        url: None means the environment variable SIMYARD_STORE, else ``.simyard`` in the working directory.

    Raises:
        DocumentError: The URL is not one of a store.
        StoreUnreachable: Nothing answers there within seconds, or the bucket does not exist.
        StoreAccessDenied: The credentials or permissions do not suffice.
        StoreUnsafe: It ignores conditions on writes.
        StoreError: A newer Simyard has made it.
    """
    store = connect(chosen_url(url))
    if _record(store) is None:
        _probe(store)
        _introduce(store)
    return store


def open_existing_store(url: str | None = None) -> Store:
    """Returns the store at the URL for reading; unlike ``open_store`` it makes none.

    Args:
        url: As for ``open_store``.

    Raises:
        DocumentError: The URL is not one of a store.
        StoreUnreachable: There is no store, or nothing answers there.
        StoreAccessDenied: The credentials or permissions do not suffice.
    """
    store = connect(chosen_url(url))
    if _record(store) is None:
        raise StoreUnreachable(f"no store there: {store.url}; simyard run makes one, --store names another")
    return store


def store_id(store: Store) -> str:
    """Returns the random id that the store was given when it was first opened; part of every ARN."""
    record = _record(store)
    return (record or _introduce(store)).id


def connect(url: str, top: str | None = None) -> Store:
    """Returns the store at the URL without asking it anything.

    Args:
        url: Where it is.
        top: The URL of a folder that it is in, below which no link is followed: where others may write.

    Raises:
        DocumentError: The URL is not one of a store.
    """
    scheme, _, rest = url.partition("://")
    if "::" in url or _CREDENTIALS.search(url) or scheme not in {"file", "s3"}:
        raise _not_a_store(url)
    if scheme == "file":
        return LocalStore(_folder(url), _folder(f"{top}/") if top else None)
    bucket, _, prefix = rest.rstrip("/").partition("/")
    from tasks.storage.backends.s3 import S3Store  # noqa: PLC0415 - a folder must not pay for importing an S3 client

    return S3Store(checked_bucket(bucket), checked_key(prefix) if prefix else "")


def chosen_url(url: str | None) -> str:
    """Returns the URL of the store that is meant; None as for ``open_store``."""
    return url or os.environ.get("SIMYARD_STORE") or (Path.cwd() / ".simyard").as_uri()


def _folder(url: str) -> Path:
    parts = urlsplit(url)
    path = Path(unquote(url.removeprefix("file://")))
    if parts.netloc or not path.is_absolute() or ".." in path.parts:
        raise _not_a_store(url)
    return path


def _not_a_store(url: str) -> DocumentError:
    shown = _CREDENTIALS.sub("//***@", url)
    allowed = _URL_RULE if "://" in url else f"{_URL_RULE}; perhaps {Path(shown).resolve().as_uri()}"
    return DocumentError.of("store", repr(shown), allowed, source="--store or SIMYARD_STORE")


def _record(store: Store) -> _StoreRecord | None:
    try:
        stored = store.get(STORE, _MOST_BYTES)
    except ObjectNotFound:
        return None
    return _known(decode_document(_StoreRecord, stored, store, STORE), store)


def _known(record: _StoreRecord, store: Store) -> _StoreRecord:
    """Returns the record of a store whose layout this Simyard knows; another one may mean something else by a key.

    Raises:
        StoreError: It is a newer one's.
    """
    if record.layout > _LAYOUT:
        made = f"its objects lie as in layout {record.layout}, and this Simyard knows layout {_LAYOUT}"
        raise StoreError(f"{store.url}: a newer Simyard has made this store: {made}; upgrade this one")
    return record


def _introduce(store: Store) -> _StoreRecord:
    record = _StoreRecord(id=uuid4().hex[:12], layout=_LAYOUT, created_at_s=time.time())
    try:
        store.create(STORE, encode_document(record))
    except ObjectExists:  # another process was first, and its id is the store's
        return decode_document(_StoreRecord, store.get(STORE, _MOST_BYTES), store, STORE)
    return record


def _probe(store: Store) -> None:
    key = f"probe/{uuid4().hex}"
    first = store.create(key, b'{"probe": 1}')
    try:
        if not _is_refused(lambda: store.create(key, b'{"probe": 2}'), ObjectExists):
            raise _unsafe(store, "let a second writer create an object that was there")
        store.replace(key, b'{"probe": 3}', first)
        if not _is_refused(lambda: store.replace(key, b'{"probe": 4}', first), ObjectConflict):
            raise _unsafe(store, "let a writer replace an object that had changed since it read it")
    finally:
        store.delete(key)


def _is_refused(write: Callable[[], str], refusal: type[StoreError]) -> bool:
    try:
        write()
    except refusal:
        return True
    return False


def _unsafe(store: Store, what: str) -> StoreUnsafe:
    return StoreUnsafe(f"{store.url} {what}; use a store that honours If-Match and If-None-Match on writes")
