"""Fetched files by the SHA-256 of their content, on this machine; what is missing is fetched again.

objects/<sha256>    a file, read-only
seen/<digest>.json  what an object of a bucket was when it was last fetched, by the bucket's own mark
mounts/<digest>     the folder that a job sees of a data source, read-only
"""

import hashlib
import shutil
import uuid
from pathlib import Path

from pydantic import ValidationError

from tasks.simulate.data_plan import PinnedFile
from tasks.storage.archives import digest_of
from tasks.storage.atomic import whole_file
from tasks.storage.store import Store

_READ_ONLY_FILE, _READ_ONLY_FOLDER = 0o444, 0o555


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
        found = self._download(bucket, key)
        with whole_file(note) as file:
            file.write(found.model_dump_json().encode())
        return found

    def path(self, sha256: str) -> Path:
        """Returns where the file with that content is, or would be."""
        return self._objects / sha256

    def mount(self, digest: str) -> Path:
        """Returns the folder of a data source with that digest, which may not be there yet."""
        return self._mounts / digest

    def install(self, staged: Path, digest: str) -> Path:
        """Returns the folder of a data source, made read-only, of what was staged for it."""
        target = self.mount(digest)
        for path in sorted(staged.rglob("*"), reverse=True):
            path.chmod(_READ_ONLY_FOLDER if path.is_dir() else _READ_ONLY_FILE)
        try:
            staged.rename(target)
        except OSError:
            if not target.is_dir():  # else another process was faster, with the same files
                raise
            discard(staged)
        return target

    def stage(self, digest: str) -> Path:
        """Returns a new empty folder in which a data source's files are put together."""
        folder = self._mounts / f".{digest}.{uuid.uuid4().hex[:8]}.tmp"
        folder.mkdir(parents=True)
        return folder

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
