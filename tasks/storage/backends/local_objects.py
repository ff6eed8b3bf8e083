"""The files of a store's folder: since when each is there by the disk's clock, and the errors for what went wrong."""

import errno
import hashlib
import os
import stat
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from specs.errors import ObjectExists, StoreAccessDenied, StoreError, StoreFull, StoreUnreachable
from tasks.storage.base.atomic_file import HIDDEN, flush_to_disk, hidden_file
from tasks.storage.base.disk_space import NO_ROOM, full_disk_message
from tasks.storage.base.folder_rights import missing_right
from tasks.storage.base.store import Entry

NOTHING_THERE = (errno.ENOENT, errno.ENOTDIR, errno.EISDIR)
_SCANS_AT_MOST, _TICK_NS = 5, 20_000_000
_REFUSED = (errno.EACCES, errno.EPERM, errno.EROFS)
# Whoever can write to the folder may leave a named pipe, a device or a link there: nobody waits for the one, reads from
# the other without end, or is led out of the folder by the third.
_READ = os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC
_ETAG_BYTES, _BLOCK_BYTES = 16, 1 << 18


def disk_error(exc: OSError, url: str, root: Path, key: str) -> StoreError:
    """Returns the store's error for what the disk said while the key was worked on.

    Args:
        exc: What the system said.
        url: The store's.
        root: The store's folder.
        key: What was worked on.
    """
    if exc.errno in _REFUSED:
        why = missing_right(Path(exc.filename)) if exc.filename and exc.errno != errno.EROFS else ""
        remedy = f"{why}; docs/operate/robot.md" if why else "make the folder writable or choose another"
        return StoreAccessDenied(f"{url}: {key}: {exc.strerror}; {remedy}")
    if exc.errno in (*NOTHING_THERE, errno.EEXIST):
        return StoreUnreachable(f"{url}: {key}: {exc.strerror}; the store must be a folder that can be made")
    if exc.errno in NO_ROOM:
        return StoreFull(f"{url}: {key}: {full_disk_message(exc, root)}")
    return StoreError(f"{url}: {key}: {exc.strerror}")


def taken_error(path: Path, url: str, key: str) -> StoreError:
    """Returns what is said of a name that is taken where an object was to be made."""
    try:
        regular = stat.S_ISREG(path.lstat().st_mode)
    except FileNotFoundError:
        regular = True  # it was there a moment ago, and somebody has removed it since
    if regular:
        return ObjectExists(f"{url}: {key} exists already")
    return StoreError(f"{url}: {key} is no regular file, and where an object belongs; remove it")


def open_object(path: Path) -> BinaryIO:
    """Returns an object's file, opened for reading; a directory, pipe, device or link is none.

    Raises:
        OSError: There is none; EISDIR, as for a directory, for whatever else is no regular file.
    """
    try:
        descriptor = os.open(path, _READ)
    except OSError as exc:
        if exc.errno in (errno.ELOOP, errno.ENXIO):  # a link; a socket, or a device that nothing drives
            raise _not_regular(path) from exc
        raise
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise _not_regular(path)
    return os.fdopen(descriptor, "rb")


def body_etag(body: bytes) -> str:
    """Returns the etag of an object with these bytes."""
    return hashlib.blake2b(body, digest_size=_ETAG_BYTES).hexdigest()


def file_etag(path: Path) -> str:
    """Returns the etag of an object's file, a part of it in memory at a time."""
    hashed = hashlib.blake2b(digest_size=_ETAG_BYTES)
    with open_object(path) as file:
        while block := file.read(_BLOCK_BYTES):
            hashed.update(block)
    return hashed.hexdigest()


def _not_regular(path: Path) -> OSError:
    return OSError(errno.EISDIR, "no regular file", str(path))


def shown_files(root: Path, top: Path) -> Iterator[str]:
    """Yields the keys of the objects at ``top`` and below, in no order; hidden files are none."""
    for base, names in _walked(top):
        folder = base.relative_to(root)
        yield from ((folder / name).as_posix() for name in names if not name.startswith("."))


def file_entry(key: str, path: Path) -> Entry | None:
    """Returns a file as a listing shows it, or None if it is gone."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return None
    return Entry(key, found.st_size, found.st_mtime, file_mark(found))


def file_mark(found: os.stat_result) -> str:
    """Returns what changes whenever an object is written: its file's identity, size and time of the last change."""
    return f"{found.st_ino}-{found.st_size}-{found.st_mtime_ns}"


def unfinished_files(root: Path, top: Path) -> Iterator[Entry]:
    """Yields the files whose writers have not given them their names, or died before."""
    for base, names in _walked(top):
        for name in names:
            path = base / name
            if name.startswith(HIDDEN) and (entry := file_entry(path.relative_to(root).as_posix(), path)):
                yield entry


def disk_now_s(folder: Path) -> float:
    """Returns the time by the clock of the disk, which is another machine's if that exports the folder."""
    with hidden_file(folder) as (file, path):
        file.write(b"now")
        flush_to_disk(file)
        return path.stat().st_mtime


def _walked(top: Path) -> Iterator[tuple[Path, list[str]]]:
    """Yields each folder, hidden ones left out, with the names of its files."""
    left = [top]
    while left:
        folder = left.pop()
        found = _scanned(folder)
        left += [folder / name for name, is_folder in found.items() if is_folder and not name.startswith(".")]
        yield folder, [name for name, is_folder in found.items() if not is_folder]


def _scanned(folder: Path) -> dict[str, bool]:
    """Returns the names in a folder, and whether each is a folder's.

    A name that is given to another file meanwhile may be left out, though it is there all along: so it is read again
    until nobody has changed it, and all that was found counts (docs/reference/store.md, section 11).
    """
    found: dict[str, bool] = {}
    try:
        for _ in range(_SCANS_AT_MOST):
            before_ns = folder.stat().st_mtime_ns
            with os.scandir(folder) as names:
                entries = list(names)  # at once: what takes time between two of them lets more be missed
            found |= {each.name: each.is_dir() for each in entries if not (each.is_symlink() and each.is_dir())}
            after_ns = folder.stat().st_mtime_ns
            # A change within a tick of the disk's clock may leave no trace.
            if after_ns == before_ns and abs(time.time_ns() - after_ns) > _TICK_NS:
                break
    except OSError as exc:
        if exc.errno not in NOTHING_THERE:
            raise
    return found


def open_lock(path: Path) -> int:
    """Returns a lock's file, opened, having made it if there was none.

    One that another account made can often only be read: that is enough to lock it, but for disks of other machines.
    """
    if not path.exists():
        with hidden_file(path.parent) as (_, hidden), suppress(FileExistsError):
            path.hardlink_to(hidden)
    try:
        return os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except PermissionError:
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
