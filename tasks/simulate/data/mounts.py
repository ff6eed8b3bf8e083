"""Mounts data sources where a chunk is simulated: a read-only folder for each, and a variable that names it."""

import errno
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from specs.data.episode import EpisodeRequest, Failure
from specs.errors import BundleRefused, ObjectNotFound, StoreAccessDenied
from tasks.simulate.data.content_cache import DataCache, discard
from tasks.simulate.data.sources import DATA_PREFIX, PinnedSource
from tasks.simulate.data.unpack import unpack_archive
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket

_BLOCK_BYTES = 1 << 20


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
        return request.model_copy(update={"environment": environment})

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
