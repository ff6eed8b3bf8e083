"""The garbage of this machine's cache: compiled programs, unpacked bundles and data that nobody has used for long.

Keys, robots' disks and Prefect's database lie in the same folder, and are never touched. An entry goes when nobody has
read or written anything in it for long, by the clock of the disk; it is moved aside before it is removed, and looked at
again there, so that who comes for it finds it whole or not at all.
"""

import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

from tasks.storage.backends.local_objects import disk_now_s
from tasks.storage.base.keys import STORE

_ENTRIES = {
    "compiled programs": "programs",
    "unpacked bundles": "bundles",
    "data objects": "data/objects",
    "data mounts": "data/mounts",
    "notes of data": "data/seen",
    "engines": "engines",
    "timings": "timings",
    "nights": "trends",
}
_ASIDE = ".gc-"


@dataclass(frozen=True)
class CacheEntry:
    """Something in the cache.

    Attributes:
        path: A file, or a folder with all that is in it.
        what: Its kind.
        size_bytes: Of all that is in it.
        used_s: When anything in it was read or written last, as the disk tells it.
    """

    path: Path
    what: str
    size_bytes: int
    used_s: float


def unused_entries(cache: Path, unused_s: float) -> list[CacheEntry]:
    """Returns what nobody has used for so long.

    Args:
        cache: The folder; it need not be there.
        unused_s: Seconds.
    """
    if not cache.is_dir() or (cache / STORE).exists():  # a store keeps its bundles in a folder of the same name
        return []
    before_s = disk_now_s(cache) - unused_s
    return [entry for entry in _cached(cache) if entry.used_s <= before_s]


def remove_entry(entry: CacheEntry) -> bool:
    """Removes an entry; returns whether it is gone: one that was used since it was seen stays."""
    aside = entry.path.with_name(f"{_ASIDE}{uuid4().hex}")
    try:
        entry.path.rename(aside)
    except FileNotFoundError:  # another gc was faster
        return True
    now = _seen(aside, entry.what)
    if now.used_s > entry.used_s and not entry.path.name.startswith("."):
        _put_back(aside, entry.path)
        return False
    remove_path(aside)
    return True


def _put_back(aside: Path, path: Path) -> None:
    try:
        if aside.is_dir() and not aside.is_symlink():
            aside.rename(path)
            return
        path.hardlink_to(aside)  # a rename would write over a newer one
    except OSError:  # made again meanwhile
        pass
    remove_path(aside)


def _cached(cache: Path) -> Iterator[CacheEntry]:
    for what, folder in _ENTRIES.items():
        if (cache / folder).is_dir():
            yield from (_seen(path, what) for path in sorted((cache / folder).iterdir()))


def _seen(path: Path, what: str) -> CacheEntry:
    found = [each for each in (_stat(path), *(_stat(Path(base, name)) for base, name in _names(path))) if each]
    size_bytes = sum(each.st_size for each in found if stat.S_ISREG(each.st_mode))
    # Reading a folder's names, as this does, is no use of what is in it.
    return CacheEntry(path, what, size_bytes, max((_used_s(each) for each in found), default=0.0))


def _used_s(found: os.stat_result) -> float:
    # Reading a folder's names, as housekeeping does, is no use of what is in it.
    return found.st_mtime if stat.S_ISDIR(found.st_mode) else max(found.st_atime, found.st_mtime)


def _names(path: Path) -> Iterator[tuple[str, str]]:
    for base, folders, files in os.walk(path) if not path.is_symlink() else ():
        yield from ((base, name) for name in (*folders, *files))


def _stat(path: Path) -> os.stat_result | None:
    try:
        return path.lstat()
    except FileNotFoundError:
        return None


def remove_path(path: Path) -> None:
    """Removes a file, a link, or a folder whose own folders may be read-only.

    Another gc may remove it, too, or move it. Nothing behind a link is touched.
    """
    if path.is_symlink() or not path.is_dir():
        path.unlink(missing_ok=True)
        return
    for base, _, _ in os.walk(path):
        with suppress(FileNotFoundError):
            Path(base).chmod(0o755)
    shutil.rmtree(path, onerror=_raise_unless_gone)


def _raise_unless_gone(_function: object, _path: str, found: tuple[object, BaseException, object]) -> None:
    if not isinstance(found[1], FileNotFoundError):
        raise found[1]
