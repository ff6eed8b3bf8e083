"""What went wrong with a store's folder, in Simyard's words."""

import errno
from pathlib import Path

from specs.errors import StoreAccessDenied, StoreError, StoreFull, StoreUnreachable
from tasks.storage.room import NO_ROOM, told_full

NOTHING_THERE = (errno.ENOENT, errno.ENOTDIR, errno.EISDIR)
_REFUSED = (errno.EACCES, errno.EPERM, errno.EROFS)


def explained_error(exc: OSError, url: str, root: Path, key: str) -> StoreError:
    """Returns the store's error for what the disk said while the key was worked on."""
    if exc.errno in _REFUSED:
        return StoreAccessDenied(f"{url}: {key}: {exc.strerror}; make the folder writable or choose another")
    if exc.errno in (*NOTHING_THERE, errno.EEXIST):
        return StoreUnreachable(f"{url}: {key}: {exc.strerror}; the store must be a folder that can be made")
    if exc.errno in NO_ROOM:
        return StoreFull(f"{url}: {key}: {told_full(exc, root)}")
    return StoreError(f"{url}: {key}: {exc.strerror}")
