"""A store in a folder of this machine, or of a disk that several machines share.

What the plain file calls do not give (docs/reference/store.md, sections 1 and 8) comes from links and locks: a creation
is a link, which the kernel refuses when the name is taken; an overwrite is a rename; a compare-and-swap compares under
a lock that the kernel frees when its holder dies. Ages of files are told by the disk's clock. Links lead nowhere: who
writes into the folder could lead out of it by one (section 13).
"""

import errno
import fcntl
import hashlib
import os
import shutil
import stat
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from specs.errors import (
    ObjectConflict,
    ObjectExists,
    ObjectNotFound,
    ObjectTooBig,
    StoreAccessDenied,
    StoreAway,
    StoreDamaged,
    StoreError,
    StoreFull,
    StoreUnreachable,
    StoreUnsafe,
)
from tasks.storage.base.keys import MOST_KEY_BYTES, checked_key
from tasks.storage.base.local_files import (
    HIDDEN,
    NO_ROOM,
    flush_to_disk,
    full_disk_message,
    held_folder,
    hidden_file,
    missing_right,
    room_in,
    settle_names,
    whole_file,
)
from tasks.storage.base.store import UNBOUNDED, Entry, StoredObject

NOTHING_THERE = (errno.ENOENT, errno.ENOTDIR, errno.EISDIR)
_SCANS_AT_MOST, _TICK_NS = 5, 20_000_000
_REFUSED = (errno.EACCES, errno.EPERM, errno.EROFS)
# Whoever can write to the folder may leave a named pipe, a device or a link there: nobody waits for the one, reads from
# the other without end, or is led out of the folder by the third.
_NO_WAY_OUT = os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC
_ETAG_BYTES, _BLOCK_BYTES = 16, 1 << 18
LOCKS = ".locks"
"""The folder of a store in which whoever writes takes a lock."""
_LONGEST_WAIT_S, _LOCK_POLL_S = 10.0, 0.001
_NO_LINK = "put in its place what it leads to, or mount that there"
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.ENOSYS)


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
    if exc.errno == errno.ELOOP:
        return StoreError(f"{url}: {key}: {exc.filename} is a link, which could lead out of the store; {_NO_LINK}")
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
        descriptor = os.open(path, os.O_RDONLY | _NO_WAY_OUT)
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


def file_entry(key: str, path: Path | str) -> Entry | None:
    """Returns a file as a listing shows it, or None if it is gone, or no regular file."""
    try:
        found = os.stat(path, follow_symlinks=False)  # noqa: PTH116 - a list of ten thousand makes no Path of each
    except FileNotFoundError:
        return None
    return Entry(key, found.st_size, found.st_mtime, file_mark(found)) if stat.S_ISREG(found.st_mode) else None


def file_mark(found: os.stat_result) -> str:
    """Returns what changes whenever an object is written: its file's identity, size and time of the last change."""
    return f"{found.st_ino}-{found.st_size}-{found.st_mtime_ns}"


def disk_now_s(folder: Path) -> float:
    """Returns the time by the clock of the disk, which is another machine's if that exports the folder."""
    with hidden_file(folder) as (file, path):
        file.write(b"now")
        flush_to_disk(file)
        return path.stat().st_mtime


def _scanned(folder: Path) -> dict[str, bool]:
    """Returns the names of the folders and regular files in a folder, and whether each is a folder's.

    A name that is given to another file meanwhile may be left out, though it is there all along: so it is read again
    until nobody has changed it, and all that was found counts (docs/reference/store.md, section 11).
    """
    found: dict[str, bool] = {}
    try:
        for _ in range(_SCANS_AT_MOST):
            before_ns = folder.stat().st_mtime_ns
            with os.scandir(folder) as names:
                entries = list(names)  # at once: what takes time between two of them lets more be missed
            found |= {each.name: is_folder for each in entries if (is_folder := _is_folder(each)) is not None}
            after_ns = folder.stat().st_mtime_ns
            # A change within a tick of the disk's clock may leave no trace.
            if after_ns == before_ns and abs(time.time_ns() - after_ns) > _TICK_NS:
                break
    except OSError as exc:
        if exc.errno not in NOTHING_THERE:
            raise
    return found


def _is_folder(each: os.DirEntry[str]) -> bool | None:
    """Returns whether a name is a folder's and not a regular file's; None for whatever else, such as a link."""
    is_folder = each.is_dir(follow_symlinks=False)
    return is_folder if is_folder or each.is_file(follow_symlinks=False) else None


def open_lock(path: Path) -> int:
    """Returns a lock's file, opened, having made it if there was none.

    One that another account made can often only be read: that is enough to lock it, but for disks of other machines.
    """
    if not os.path.lexists(path):
        with hidden_file(path.parent) as (_, hidden), suppress(FileExistsError):
            path.hardlink_to(hidden)
    try:
        return os.open(path, os.O_RDWR | _NO_WAY_OUT)
    except PermissionError:
        return os.open(path, os.O_RDONLY | _NO_WAY_OUT)


class LocalStore:
    """Objects as files under ``root``; see ``tasks.storage.base.store.Store`` for what the methods promise.

    Args:
        root: The folder.
        top: The folder above it, or itself, below which no link is followed: where others may write. Itself by default.
    """

    def __init__(self, root: Path, top: Path | None = None) -> None:
        self.root, self._top = root, top or root
        self._below = tuple(root.relative_to(self._top).parts)
        self.url = root.as_uri()

    def create(self, key: str, body: bytes) -> str:
        """Returns the etag of a new object, or raises ObjectExists."""
        with self._explained(key), self._place(key, make=True) as path:
            if os.path.lexists(path):  # spares the loser the writing; the link decides
                raise taken_error(path, self.url, key)
            with hidden_file(path.parent) as (file, hidden):
                file.write(body)
                flush_to_disk(file)
                self._link(hidden, path, key)
            settle_names(path.parent)
        return body_etag(body)

    def replace(self, key: str, body: bytes, etag: str) -> str:
        """Returns the new etag, or raises ObjectConflict when the object is not the one with ``etag``."""
        with self._explained(key), self._place(key) as path:
            self._compare(path, key, etag)  # spares the loser the writing; the comparison under the lock decides
            with hidden_file(path.parent) as (file, hidden):
                file.write(body)
                flush_to_disk(file)
                with self._locked(key):
                    self._compare(path, key, etag)
                    hidden.replace(path)
            settle_names(path.parent)
        return body_etag(body)

    def put(self, key: str, body: bytes) -> str:
        """Returns the etag of the object written over whatever was there."""
        with self._explained(key), self._place(key, make=True) as path:
            with hidden_file(path.parent) as (file, hidden):
                file.write(body)
                flush_to_disk(file)
                # Under the lock too, or it could land between another's comparison and its rename, and be lost.
                with self._locked(key):
                    hidden.replace(path)
            settle_names(path.parent)
        return body_etag(body)

    def get(self, key: str, most_bytes: int = UNBOUNDED) -> StoredObject:
        """Returns the object, or raises ObjectNotFound, or ObjectTooBig."""
        with self._explained(key, reading=True), self._place(key) as path, open_object(path) as file:
            size = os.fstat(file.fileno()).st_size
            if size > most_bytes:
                raise ObjectTooBig(f"{self.url}: {key} has more than {most_bytes} bytes")
            body = file.read(size)  # objects never grow; a file that somebody else writes may do so for ever
        return StoredObject(body, body_etag(body))

    def size(self, key: str) -> int:
        """Returns how many bytes the object has, or raises ObjectNotFound."""
        with self._explained(key, reading=True), self._place(key) as path, open_object(path) as file:
            return os.fstat(file.fileno()).st_size

    def etag(self, key: str) -> str:
        """Returns the object's etag, or raises ObjectNotFound; all of it is read."""
        with self._explained(key, reading=True), self._place(key) as path:
            return file_etag(path)

    def blocks(self, key: str, first_byte: int = 0) -> Generator[bytes]:
        """Yields the object's bytes from one of them on, or raises ObjectNotFound."""
        with self._explained(key, reading=True), self._place(key) as path:
            file = open_object(path)
        with file:
            file.seek(first_byte)
            while block := self._block(file, key):
                yield block

    def exists(self, key: str) -> bool:
        """Returns whether there is an object under the key."""
        try:
            self.entry(key)
        except ObjectNotFound:
            return False
        return True

    def mark(self, key: str) -> str:
        """Returns the file's identity, size and time of its last change, or raises ObjectNotFound."""
        return self.entry(key).mark

    def keys(self, prefix: str) -> list[str]:
        """Returns the keys in the folder and below, sorted, without hidden files."""
        with self._explained(prefix):
            walked = self._walked(prefix)
            return sorted(folder + name for folder, _, names in walked for name in names if not name.startswith("."))

    def entries(self, prefix: str) -> list[Entry]:
        """Returns the keys in the folder and below, sorted, each with its size and age."""
        return self._found(prefix, lambda name: not name.startswith("."))

    def entry(self, key: str) -> Entry:
        """Returns one object with its size and age, or raises ObjectNotFound."""
        with self._explained(key, reading=True), self._place(key) as path:
            found = file_entry(key, path)
        if found is None:
            raise ObjectNotFound(f"{self.url}: no object {key}")
        return found

    def now_s(self) -> float:
        """Returns the time by the clock of the disk."""
        with self._explained(LOCKS), self._held(LOCKS, make=True) as folder:
            return disk_now_s(folder)

    def delete_unchanged(self, entry: Entry) -> bool:
        """Removes the object unless it was written since, in one step; returns whether it is gone now."""
        if not self.exists(entry.key):
            return True
        with self._explained(entry.key), self._place(entry.key) as path, self._locked(entry.key):
            found = file_entry(entry.key, path)
            if found is not None and found.mark != entry.mark:
                return False
            path.unlink(missing_ok=True)
            return True

    def unfinished(self, prefix: str) -> list[Entry]:
        """Returns the hidden files in the folder and below that writers have left, or are writing."""
        return self._found(prefix, lambda name: name.startswith(HIDDEN))

    def discard(self, write: Entry) -> None:
        """Removes a hidden file that a writer has left."""
        folder, _, name = write.key.rpartition("/")
        with suppress(ObjectNotFound), self._explained(write.key, reading=True), self._held(folder) as held:
            (held / name).unlink(missing_ok=True)

    def delete(self, key: str) -> None:
        """Removes the object if it is there."""
        if not self.exists(key):
            return
        with self._explained(key), self._place(key) as path, self._locked(key):
            path.unlink(missing_ok=True)
            settle_names(path.parent)

    def upload(self, key: str, source: Path) -> None:
        """Copies the file under the key; readers see the old object or the whole new one."""
        with (
            source.open("rb") as reader,
            self._explained(key),
            self._place(key, make=True) as path,
            hidden_file(path.parent, _mark(key)) as (file, hidden),
        ):
            shutil.copyfileobj(reader, file, 1 << 20)
            flush_to_disk(file)
            if hidden.stat().st_size != reader.tell():
                raise StoreDamaged(f"{self.url}: {key}: what was written is not what was to be")
            with self._locked(key):
                hidden.replace(path)
            settle_names(path.parent)

    def sweep(self, key: str) -> None:
        """Removes what uploads of the key that were killed have left."""
        with suppress(ObjectNotFound), self._explained(key, reading=True), self._place(key) as path:
            for left in path.parent.glob(f"{HIDDEN}{_mark(key)}*"):
                left.unlink(missing_ok=True)

    def download(self, key: str, target: Path) -> None:
        """Copies the object to the file, which appears whole or not at all."""
        with self._explained(key, reading=True), self._place(key) as path:
            reader = open_object(path)
        with reader, room_in(target.parent), whole_file(target) as file:
            shutil.copyfileobj(reader, file, 1 << 20)

    def _block(self, file: BinaryIO, key: str) -> bytes:
        with self._explained(key):
            return file.read(1 << 18)

    def _held(self, folder: str, *, make: bool = False) -> AbstractContextManager[Path]:
        return held_folder(self._top, "/".join(filter(None, (*self._below, folder))), make=make)

    @contextmanager
    def _place(self, key: str, *, make: bool = False) -> Generator[Path]:
        """Yields where the key's file is, whatever the names of its folders lead to by then."""
        folder, _, name = checked_key(key).rpartition("/")
        with self._held(folder, make=make) as held:
            yield held / name

    def _found(self, prefix: str, is_wanted: Callable[[str], bool]) -> list[Entry]:
        with self._explained(prefix):
            found = (
                file_entry(folder + name, f"{held}/{name}")
                for folder, held, names in self._walked(prefix)
                for name in names
                if is_wanted(name)
            )
            return sorted((entry for entry in found if entry), key=lambda entry: entry.key)

    def _walked(self, prefix: str) -> Iterator[tuple[str, Path, list[str]]]:
        """Yields each folder, hidden ones left out: what its keys begin with, where it is now, its files' names."""
        left = [checked_key(prefix.rstrip("/")) if prefix else ""]
        while left:
            folder = left.pop()
            try:
                with self._held(folder) as held:
                    found, start = _scanned(held), f"{folder}/" if folder else ""
                    yield start, held, [name for name, is_folder in found.items() if not is_folder]
            except OSError as exc:
                if exc.errno not in NOTHING_THERE:
                    raise
            else:
                below = (start + name for name, is_folder in found.items() if is_folder and not name.startswith("."))
                left += [each for each in below if len(os.fsencode(each)) < MOST_KEY_BYTES]

    def _link(self, hidden: Path, path: Path, key: str) -> None:
        try:
            path.hardlink_to(hidden)
        except FileExistsError as exc:
            raise taken_error(path, self.url, key) from exc
        except OSError as exc:
            if exc.errno in _NO_LINKS:
                raise StoreUnsafe(f"{self.url}: its disk has no hard links; use a folder on another disk") from exc
            raise

    def _compare(self, path: Path, key: str, etag: str) -> None:
        try:
            current = file_etag(path)
        except OSError as exc:
            if exc.errno not in NOTHING_THERE:
                raise
            raise ObjectConflict(f"{self.url}: {key} is gone") from exc
        if current != etag:
            raise ObjectConflict(f"{self.url}: {key} has changed since it was read")

    @contextmanager
    def _locked(self, key: str) -> Generator[None]:
        # A few shared lock files instead of one beside every object; nothing takes two, so nothing deadlocks. Nobody
        # waits for a disk while it has one, so that hardly anybody is paused with it.
        with self._held(LOCKS, make=True) as folder:
            descriptor = open_lock(folder / hashlib.blake2b(key.encode(), digest_size=1).hexdigest())
        try:
            self._lock(descriptor, key)
            yield
        finally:
            # Closing alone would leave the lock with a child that was forked meanwhile.
            fcntl.flock(descriptor, fcntl.LOCK_UN)
            os.close(descriptor)

    def _lock(self, descriptor: int, key: str) -> None:
        until_s = time.monotonic() + _LONGEST_WAIT_S
        while True:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as exc:
                if time.monotonic() > until_s:
                    raise StoreAway(f"{self.url}: {key}: a process that is paused, or hangs, has the lock") from exc
                time.sleep(_LOCK_POLL_S)
            else:
                return

    @contextmanager
    def _explained(self, key: str, *, reading: bool = False) -> Generator[None]:
        try:
            yield
        except OSError as exc:
            if reading and exc.errno in NOTHING_THERE:
                raise ObjectNotFound(f"{self.url}: no object {key}") from exc
            raise disk_error(exc, self.url, self.root, key) from exc


def _mark(key: str) -> str:
    """Returns what the hidden names of a key's uploads have in common."""
    return f"{hashlib.blake2b(key.encode(), digest_size=8).hexdigest()}-"
