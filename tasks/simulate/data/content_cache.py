"""The cache of fetched files on this machine, by the SHA-256 of their content; what is missing is fetched again.

objects/<sha256>    a file, read-only
seen/<digest>.json  what an object of a bucket was when it was last fetched, by the bucket's own mark
mounts/<digest>     files/, which a job sees of a data source, read-only; and a seal, by which a change is noticed

Who is root writes into read-only files too, so that a mount is used again only as long as its seal fits. It holds what
the file system notes of each file: a write changes that, whoever writes.
"""

import hashlib
import json
import shutil
import uuid
from pathlib import Path

from pydantic import ValidationError

from tasks.simulate.data.sources import PinnedFile
from tasks.storage.archives import digest_of
from tasks.storage.base.atomic_file import whole_file
from tasks.storage.base.store import Store

_READ_ONLY_FILE, _READ_ONLY_FOLDER = 0o444, 0o555
_FILES, _SEAL = "files", "seal"


class DataCache:
    """A folder of fetched files; several processes may use it at once."""

    def __init__(self, folder: Path) -> None:
        self._objects, self._seen, self._mounts = folder / "objects", folder / "seen", folder / "mounts"

    def fetched(self, bucket: Store, key: str) -> PinnedFile:
        """Returns what an object of a bucket is now; its content is in the cache then.

        Raises:
            ObjectNotFound: There is none.
        """
        mark = bucket.mark(key)
        note = self._seen / f"{hashlib.sha256(f'{bucket.url}|{key}|{mark}'.encode()).hexdigest()}.json"
        known = _noted(note)
        if known is not None and self.path(known.sha256).is_file():
            return known
        etag = bucket.etag(key).strip('"')
        found = self._download(bucket, key).model_copy(update={"etag": etag})
        with whole_file(note) as file:
            file.write(json.dumps({**found.model_dump(mode="json"), "etag": etag}).encode())
        return found

    def path(self, sha256: str) -> Path:
        """Returns where the file with that content is, or would be."""
        return self._objects / sha256

    def mounted(self, digest: str) -> Path | None:
        """Returns the folder of a data source with that digest; None if it is not there as it was installed."""
        mount = self._mounts / digest
        try:
            sound = (mount / _SEAL).read_text() == _seal(mount / _FILES)
        except FileNotFoundError:
            sound = False
        return mount / _FILES if sound else None

    def install(self, staged: Path, digest: str) -> Path:
        """Returns the folder of a data source, made read-only, of what was staged for it."""
        target = self._mounts / digest
        for path in sorted(staged.rglob("*"), reverse=True):
            path.chmod(_READ_ONLY_FOLDER if path.is_dir() else _READ_ONLY_FILE)
        (staged / _SEAL).write_text(_seal(staged / _FILES))
        if target.is_dir() and self.mounted(digest) is None:
            self._put_away(target)
        try:
            staged.rename(target)
        except OSError:
            if self.mounted(digest) is None:  # else another process was faster, with the same files
                raise
        return target / _FILES

    def stage(self, digest: str) -> tuple[Path, Path]:
        """Returns a new folder to install or to discard, and the one in it that a data source's files go into."""
        folder = self._beside(digest)
        (folder / _FILES).mkdir(parents=True)
        return folder, folder / _FILES

    def _put_away(self, mount: Path) -> None:
        """Removes a mount that was written into."""
        away = self._beside(mount.name)
        try:
            mount.rename(away)
        except FileNotFoundError:  # another process has put it away
            return
        discard(away)

    def _beside(self, digest: str) -> Path:
        return self._mounts / f".{digest}.{uuid.uuid4().hex[:8]}.tmp"

    def _download(self, bucket: Store, key: str) -> PinnedFile:
        self._objects.mkdir(parents=True, exist_ok=True)
        temporary = self._objects / f".{uuid.uuid4().hex}.tmp"
        try:
            bucket.download(key, temporary)
            found = PinnedFile(key=key, sha256=digest_of(temporary), size_bytes=temporary.stat().st_size)
            temporary.chmod(_READ_ONLY_FILE)
            temporary.rename(self.path(found.sha256))
        finally:
            temporary.unlink(missing_ok=True)
        return found


def _seal(folder: Path) -> str:
    """Returns a digest of the names below a folder, and of what a write into a file changes."""
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        stat = path.lstat()
        # The time of the inode's last change, which nobody can set; that of a folder changes when it is moved.
        noted = () if path.is_dir() else (stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns)
        found.update(repr((path.relative_to(folder).as_posix(), noted)).encode())
    return found.hexdigest()


def discard(folder: Path) -> None:
    """Removes a folder whose own folders may be read-only."""
    for path in [folder, *folder.rglob("*")]:
        if path.is_dir():
            path.chmod(0o755)
    shutil.rmtree(folder, ignore_errors=True)


def _noted(note: Path) -> PinnedFile | None:
    try:
        return PinnedFile.model_validate_json(note.read_bytes())
    except (FileNotFoundError, ValidationError):
        return None
