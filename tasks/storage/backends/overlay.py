"""A store to try things on: reads go through, writes stay in memory and are gone with it.

`simyard plan` publishes bundles and checks them exactly as `run` will, and leaves no trace.
"""

import hashlib
import os
import weakref
from collections.abc import Generator, Iterable
from pathlib import Path

from specs.errors import ObjectConflict, ObjectExists, ObjectNotFound, ObjectTooBig
from tasks.storage.base.local_files import whole_file
from tasks.storage.base.store import UNBOUNDED, Entry, Store, StoredObject

_BLOCK_BYTES = 1 << 20


class OverlayStore:
    """Writes in memory above a store that is only read, for one process; uploads are files that it holds open."""

    def __init__(self, below: Store) -> None:
        self.url = below.url
        self._below = below
        self._written: dict[str, bytes | Path | None] = {}  # a path is of a file held open; None: deleted here

    def create(self, key: str, body: bytes) -> str:
        """Returns the new object's ETag; see Store."""
        if self.exists(key):
            raise ObjectExists(f"{self.url}: {key} is taken")
        return self.put(key, body)

    def replace(self, key: str, body: bytes, etag: str) -> str:
        """Returns the ETag of what replaces exactly what was read; see Store."""
        if not self.exists(key) or self.get(key).etag != etag:
            raise ObjectConflict(f"{self.url}: {key} is not what it was when it was read")
        return self.put(key, body)

    def put(self, key: str, body: bytes) -> str:
        """Returns the ETag of what was written; see Store."""
        self._written[key] = body
        return _etag([body])

    def get(self, key: str, most_bytes: int = UNBOUNDED) -> StoredObject:
        """Returns an object from memory, else from below; see Store."""
        if key not in self._written:
            return self._below.get(key, most_bytes)
        body = self._written[key]
        if body is None:
            raise ObjectNotFound(f"{self.url}: there is no {key}")
        size = body.stat().st_size if isinstance(body, Path) else len(body)
        if size > most_bytes:
            raise ObjectTooBig(f"{self.url}: {key} has more than {most_bytes} bytes")
        whole = body.read_bytes() if isinstance(body, Path) else body
        return StoredObject(body=whole, etag=_etag([whole]))

    def size(self, key: str) -> int:
        """Returns an object's size; see Store."""
        held = self._written.get(key)
        if isinstance(held, Path):
            return held.stat().st_size
        return len(self.get(key).body) if key in self._written else self._below.size(key)

    def etag(self, key: str) -> str:
        """Returns an object's ETag; see Store."""
        return _etag(self.blocks(key)) if key in self._written else self._below.etag(key)

    def blocks(self, key: str, first_byte: int = 0) -> Generator[bytes]:
        """Yields an object's bytes; see Store."""
        held = self._written.get(key)
        if isinstance(held, Path):
            with held.open("rb") as file:
                file.seek(first_byte)
                while block := file.read(_BLOCK_BYTES):
                    yield block
        elif key in self._written:
            yield self.get(key).body[first_byte:]
        else:
            yield from self._below.blocks(key, first_byte)

    def exists(self, key: str) -> bool:
        """Returns whether there is an object; see Store."""
        return self._written[key] is not None if key in self._written else self._below.exists(key)

    def mark(self, key: str) -> str:
        """Returns what changes whenever the object is written; see Store."""
        return self.etag(key) if key in self._written else self._below.mark(key)

    def keys(self, prefix: str) -> list[str]:
        """Returns the keys below a folder; see Store."""
        folder = f"{prefix.rstrip('/')}/" if prefix else ""
        own = {key for key in self._written if key.startswith(folder)}
        return sorted(key for key in own.union(self._below.keys(prefix)) if self.exists(key))

    def entries(self, prefix: str) -> list[Entry]:
        """Returns the objects below a folder; what was written here was written right now; see Store."""
        below = {entry.key: entry for entry in self._below.entries(prefix)}
        return [self.entry(key) if key in self._written else below[key] for key in self.keys(prefix)]

    def entry(self, key: str) -> Entry:
        """Returns one object as a listing shows it; see Store."""
        if key not in self._written:
            return self._below.entry(key)
        return Entry(key, self.size(key), self.now_s(), self.mark(key))

    def now_s(self) -> float:
        """Returns the time by the clock of the store below; see Store."""
        return self._below.now_s()

    def delete_unchanged(self, entry: Entry) -> bool:
        """Hides an object unless it was written since; see Store."""
        if self.exists(entry.key) and self.entry(entry.key).mark != entry.mark:
            return False
        self.delete(entry.key)
        return True

    def unfinished(self, prefix: str) -> list[Entry]:
        """Returns the unfinished writes of the store below; see Store."""
        return self._below.unfinished(prefix)

    def discard(self, write: Entry) -> None:
        """Removes nothing: what is below stays as it is; see Store."""

    def delete(self, key: str) -> None:
        """Hides an object; see Store."""
        self._written[key] = None

    def upload(self, key: str, source: Path) -> None:
        """Holds a file open, which its caller may remove and does not change; see Store."""
        descriptor = os.open(source, os.O_RDONLY | os.O_CLOEXEC)
        weakref.finalize(self, os.close, descriptor)
        self._written[key] = Path(f"/proc/self/fd/{descriptor}")

    def sweep(self, key: str) -> None:
        """Removes nothing: what is below stays as it is; see Store."""

    def download(self, key: str, target: Path) -> None:
        """Writes an object to a file; see Store."""
        if key not in self._written:
            self._below.download(key, target)
            return
        with whole_file(target) as file:
            for block in self.blocks(key):
                file.write(block)


def _etag(blocks: Iterable[bytes]) -> str:
    found = hashlib.md5(usedforsecurity=False)
    for block in blocks:
        found.update(block)
    return found.hexdigest()
