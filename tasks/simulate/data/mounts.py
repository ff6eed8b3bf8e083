"""Brings worlds and data sources to where a chunk is simulated.

A batch's sources are pinned once: their files are fetched, and their digests are noted, or why they cannot be used.
This machine keeps files by the SHA-256 of their content, and fetches again what is missing. A chunk gets a read-only
folder for each source, its archives unpacked without trust in what is inside, and a variable that names the folder.
"""

import errno
import functools
import gzip
import hashlib
import json
import lzma
import shutil
import tempfile
import uuid
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from specs.data.episode import EpisodeRequest, Failure
from specs.data.world import World
from specs.errors import BundleRefused, DocumentError, ObjectNotFound, StoreAccessDenied, WorldChanged
from specs.robomaker.simulation import DataSourceConfig
from tasks.simulate.data.data_sources import (
    DATA_PREFIX,
    MOST_BYTES,
    MOST_FILES,
    DataFailure,
    PinnedFile,
    PinnedSource,
    unpinned,
)
from tasks.storage.archives import ArchiveLimits, digest_of, extract, place_of_its_own, safe_parts
from tasks.storage.base.keys import checked_key
from tasks.storage.base.local_files import whole_file
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import open_store
from tasks.storage.worlds import decode_world, pinned_world_bytes

# As many as a chunk of the default size has at most.
_WORLDS_KEPT = 256


def pinned_worlds(
    store_url: str, digests: Mapping[str, str], requests: Iterable[EpisodeRequest]
) -> tuple[dict[str, World], dict[str, Failure]]:
    """Returns the worlds of episodes, and why others of them cannot be used.

    Args:
        store_url: Where they are.
        digests: SHA-256 of each world's document when the batch was planned, by ``<generation>/<world>``.
        requests: The episodes.
    """
    worlds: dict[str, World] = {}
    missing: dict[str, Failure] = {}
    for reference in dict.fromkeys(request.world for request in requests):
        try:
            worlds[reference] = _world(store_url, reference, digests[reference])
        except ObjectNotFound:
            missing[reference] = Failure("InvalidS3Resource", f"world {reference} does not exist")
        except WorldChanged:
            why = f"world {reference} is not what it was when the batch was planned"
            missing[reference] = Failure("MismatchedEtag", why)
    return worlds, missing


@functools.lru_cache(maxsize=_WORLDS_KEPT)
def _world(store_url: str, reference: str, digest: str) -> World:
    """Returns a world; the last ones are kept, since chunks that follow one another share theirs."""
    return decode_world(pinned_world_bytes(open_store(store_url), reference, digest))


ENDINGS = (".zip", ".tar.gz")
_LIMITS = ArchiveLimits(total_bytes=MOST_BYTES, entries=100_000)
_BLOCK_BYTES = 1 << 20
# What the readers of archives raise at damaged ones; RuntimeError is an encrypted one, ValueError a name or a place in
# the file that cannot be.
_DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    gzip.BadGzipFile,
    EOFError,
    NotImplementedError,
    RuntimeError,
    ValueError,
)
# bzip2 says nothing but OSError, without a number; the others are a path too long and a place before the beginning.
_DAMAGED_ERRNOS = (None, errno.ENAMETOOLONG, errno.EINVAL)


def unpack_archive(archive: Path, key: str, target: Path) -> None:
    """Unpacks a .zip or .tar.gz file into a new folder.

    Args:
        archive: The file.
        key: Its key in the bucket, whose ending says what it is.
        target: The folder to make; its parent exists.

    Raises:
        BundleRefused: It is no such archive, would write elsewhere, or holds more than a job may have.
    """
    try:
        if key.endswith(".zip"):
            _unzip(archive, target)
        else:
            _untar(archive, target)
    except _DAMAGED as exc:
        raise BundleRefused(f"{key} cannot be unpacked: {exc}") from exc
    except OSError as exc:
        if exc.errno not in _DAMAGED_ERRNOS:  # a full disk, or what stands in the way: none of the archive's faults
            raise
        raise BundleRefused(f"{key} cannot be unpacked: {exc.strerror or exc}") from exc


def _untar(archive: Path, target: Path) -> None:
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".tar-") as folder:
        plain = Path(folder) / "plain.tar"
        with gzip.open(archive) as reader, plain.open("wb") as writer:
            written = 0
            while block := reader.read(_BLOCK_BYTES):
                written += len(block)
                _require_room(written)
                writer.write(block)
        extract(plain, target, limits=_LIMITS)


def _unzip(archive: Path, target: Path) -> None:
    target.mkdir(mode=0o755)
    with zipfile.ZipFile(archive) as opened:
        members = opened.infolist()
        if len(members) > _LIMITS.entries:
            raise BundleRefused(f"more than {_LIMITS.entries:,} entries")
        _require_room(sum(member.file_size for member in members))
        for member in members:
            path = target.joinpath(*safe_parts(member.filename, _LIMITS.depth))
            with place_of_its_own(member.filename):
                if member.is_dir():
                    path.mkdir(parents=True, exist_ok=True)
                    continue
                path.parent.mkdir(parents=True, exist_ok=True)
                # As long as the header said and no longer: zipfile stops there, and checks the sum.
                with opened.open(member) as reader, path.open("xb") as writer:
                    shutil.copyfileobj(reader, writer, _BLOCK_BYTES)


def _require_room(size_bytes: int) -> None:
    if size_bytes > _LIMITS.total_bytes:
        raise BundleRefused(f"unpacks to more than {_LIMITS.total_bytes:,} bytes")


_READ_ONLY_FILE, _READ_ONLY_FOLDER = 0o444, 0o555
_FILES, _SEAL = "files", "seal"


# objects/<sha256>    a file, read-only
# seen/<digest>.json  what an object of a bucket was when it was last fetched, by the bucket's own mark
# mounts/<digest>     ``files/``, which a job sees of a data source, read-only; and a seal, by which a change is seen
#
# Who is root writes into read-only files too, so that a mount is used again only as long as its seal fits. It holds
# what the file system notes of each file: a write changes that, whoever writes.
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


class _Unusable(Exception):  # noqa: N818 - a state
    def __init__(self, code: DataFailure, why: str) -> None:
        self.code: DataFailure = code
        super().__init__(why)


# Nothing here refuses a document: a job whose file is missing is a row that says so, and the others run.
def pin_source(store: Store, cache: Path, source: DataSourceConfig) -> PinnedSource:
    """Returns a data source with the digests of its files, which are in the cache then; a failed one says why.

    Args:
        store: What the bucket's place follows from.
        cache: Folder of fetched files.
        source: As the request has it.

    Raises:
        StoreError: The bucket is not there, does not answer, or fails: that passes, and would be no job's fault.
    """
    found = unpinned(source)
    try:
        bucket = open_bucket(store, source.s3Bucket)
        safe_parts(found.destination)
        keys = _keys(bucket, source)
        return found.model_copy(update={"files": tuple(_files(bucket, source.s3Bucket, DataCache(cache), keys))})
    except _Unusable as exc:
        return found.failed(exc.code, str(exc))
    except StoreAccessDenied:
        return found.failed("BadPermissionsS3Object", f"bucket {source.s3Bucket} refuses to be read")
    except BundleRefused:
        return found.failed("InvalidInput", f"{source.destination!r} is no folder below a job's own")


def _files(bucket: Store, name: str, cache: DataCache, keys: list[str]) -> list[PinnedFile]:
    if len(keys) > MOST_FILES:
        raise _Unusable("LimitExceeded", f"{len(keys)} files; at most {MOST_FILES}")
    files: list[PinnedFile] = []
    for key in keys:
        _require_safe(key)
        try:
            files.append(cache.fetched(bucket, key))
        except ObjectNotFound as exc:  # its text names places of this machine, and a row must not
            raise _Unusable("InvalidS3Resource", f"there is no {name}/{key}") from exc
        if sum(file.size_bytes for file in files) > MOST_BYTES:
            raise _Unusable("LimitExceeded", f"more than {MOST_BYTES:,} bytes")
    return files


def _keys(bucket: Store, source: DataSourceConfig) -> list[str]:
    if source.type == "Prefix":
        found = [key for prefix in source.s3Keys for key in _below(bucket, prefix)]
        if not found:
            places = ", ".join(f"{source.s3Bucket}/{prefix}" for prefix in source.s3Keys)
            raise _Unusable("InvalidS3Resource", f"there is nothing below {places}")
        return list(dict.fromkeys(found))
    if source.type == "Archive":
        others = [key for key in source.s3Keys if not key.endswith(ENDINGS)]
        if others:
            raise _Unusable("InvalidInput", f"{others[0]!r} is no {' or '.join(ENDINGS)} file")
    return list(dict.fromkeys(source.s3Keys))


def _below(bucket: Store, prefix: str) -> list[str]:
    """Returns the keys that begin with a prefix, which need not be a whole folder's name."""
    folder, _, _ = prefix.rpartition("/")
    if folder:
        _require_safe(folder)
    return [key for key in bucket.keys(folder) if key.startswith(prefix)]


def _require_safe(key: str) -> None:
    try:
        safe_parts(checked_key(key))
    except (BundleRefused, DocumentError) as exc:
        raise _Unusable("InvalidInput", f"{key!r} is no relative path") from exc


class Mounted(NamedTuple):
    """A data source on this machine.

    Attributes:
        folder: What its variable says; None if it cannot be used.
        failure: Why it cannot.
    """

    folder: Path | None
    failure: Failure | None = None


class Mounts:
    """The data sources of a batch, mounted when a chunk first needs them."""

    def __init__(
        self,
        store: Store,
        sources: Mapping[str, PinnedSource],
        cache: Path,
        job_variables: Callable[[int], Mapping[str, str]] = lambda _: {},
    ) -> None:
        """Mounts nothing yet.

        Args:
            store: What the buckets' places follow from.
            sources: By digest.
            cache: Folder of fetched files.
            job_variables: Returns the variables that tell an application which job it is in, by the episode's index.
        """
        self._job_variables = job_variables
        self._store, self._sources, self._cache = store, sources, DataCache(cache)
        self._mounted: dict[str, Mounted] = {}

    def failure(self, request: EpisodeRequest) -> Failure | None:
        """Returns why an episode cannot be simulated; None if it can.

        Raises:
            StoreError: A bucket does not answer, or is gone.
        """
        return next((found.failure for _, found in self._of(request) if found.failure), None)

    def resolved(self, request: EpisodeRequest) -> EpisodeRequest:
        """Returns an episode whose variables name its job and folders of this machine; no data source has failed."""
        folders = {name: str(found.folder) for name, found in self._of(request)}
        environment = {**request.environment, **folders, **self._job_variables(request.index)}
        judging = request.judge_environment and {**request.judge_environment, **self._job_variables(request.index)}
        return request.model_copy(update={"environment": environment, "judge_environment": judging})

    def _of(self, request: EpisodeRequest) -> list[tuple[str, Mounted]]:
        named = {
            name: value.removeprefix(DATA_PREFIX)
            for name, value in request.environment.items()
            if value.startswith(DATA_PREFIX)
        }
        return [(name, self._mount(digest)) for name, digest in named.items() if digest in self._sources]

    def _mount(self, digest: str) -> Mounted:
        if digest not in self._mounted:
            self._mounted[digest] = self._made(digest, self._sources[digest])
        return self._mounted[digest]

    def _made(self, digest: str, source: PinnedSource) -> Mounted:
        if source.failure_code:
            return Mounted(None, Failure(source.failure_code, source.failure_reason))
        root, failure = self._cache.mounted(digest), None
        if root is None:
            if failure := self._fetch(source):
                return Mounted(None, failure)
            root, failure = self._installed(digest, source)
        return Mounted(root and root / source.destination, failure)

    def _fetch(self, source: PinnedSource) -> Failure | None:
        """Returns why a file is not in the cache and cannot be fetched again; None if all are there."""
        for file in source.files:
            if self._cache.path(file.sha256).is_file():
                continue
            where = f"data source {source.name}: {source.bucket}/{file.key}"
            try:
                found = self._cache.fetched(open_bucket(self._store, source.bucket), file.key)
            except ObjectNotFound:
                return Failure("InvalidS3Resource", f"{where} does not exist any more")
            except StoreAccessDenied:
                return Failure("BadPermissionsS3Object", f"{where} must not be read")
            if found.sha256 != file.sha256:
                return Failure("MismatchedEtag", f"{where} is not what it was when the batch was planned")
        return None

    def _installed(self, digest: str, source: PinnedSource) -> tuple[Path | None, Failure | None]:
        """Returns the folder of a data source, or why its files cannot be put together."""
        staged, files = self._cache.stage(digest)
        try:
            failure = self._put_together(files / source.destination, source)
            return (None, failure) if failure else (self._cache.install(staged, digest), None)
        finally:  # whatever went wrong; once installed, nothing is left of it
            discard(staged)

    def _put_together(self, top: Path, source: PinnedSource) -> Failure | None:
        """Returns why the files cannot be put together in a folder; None if they can."""
        top.mkdir(parents=True, exist_ok=True)
        put = _unpacked if source.type == "Archive" else _copied
        for file in source.files:
            try:
                put(file.key, self._cache.path(file.sha256), top)
            except BundleRefused as exc:
                return Failure("InvalidS3Resource", f"data source {source.name}: {exc}")
            except (FileExistsError, NotADirectoryError, IsADirectoryError):
                # What it says names places of this machine, and a row must not.
                why = f"data source {source.name}: {file.key} would be where another file is"
                return Failure("InvalidInput", why)
        return None


def _copied(key: str, content: Path, top: Path) -> None:
    """Copies a file; a link would let who writes into a mount, as root may, write into the cache."""
    target = top / key
    target.parent.mkdir(parents=True, exist_ok=True)
    with content.open("rb") as reader, target.open("xb") as writer:
        shutil.copyfileobj(reader, writer, _BLOCK_BYTES)


def _unpacked(key: str, content: Path, top: Path) -> None:
    with tempfile.TemporaryDirectory(dir=top, prefix=".archive-") as folder:
        unpacked = Path(folder) / "content"
        unpack_archive(content, key, unpacked)
        for path in sorted(unpacked.iterdir()):
            target = top / path.name
            if target.exists():
                raise FileExistsError(errno.EEXIST, "two archives hold it", str(target))
            path.rename(target)
