"""Archives of bundles: written the same way every time, and unpacked without trusting what is inside.

A bundle is a plain tar: uncompressed, so what comes out can never be larger than what came in, and the same folder
gives the same bytes on every machine, whatever its version of zlib. The extractor writes every byte itself: ``tarfile``
only reads the headers (`tasks.storage.archives`), because its own filters have been bypassed before.
"""

import gzip
import hashlib
import os
import re
import shutil
import tarfile
import tempfile
import uuid
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO, BinaryIO, cast

from specs.errors import BundleRefused
from specs.program_file import HEAD_BYTES
from tasks.storage.base.keys import bundle_key
from tasks.storage.base.local_files import OF_THE_DISK, flush_to_disk, room_in, settle_names
from tasks.storage.base.store import Store

# Of one entry: its name, up to 32 levels of 255 bytes, and what else a header of PAX holds.
_HEADER_BYTES = 1 << 15
_LONG_NUMBER = re.compile(rb"[0-9]{1024}")
_REASON_CHARACTERS = 200
_PACKED = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"\x28\xb5\x2f\xfd": "zstd", b"PK\x03\x04": "zip"}
"""How a file begins that is packed, and by what."""
_BLOCK_BYTES = 1 << 20
_NAME_BYTES = 255
_FILES = (tarfile.REGTYPE, tarfile.AREGTYPE)
_CREATE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC


# ``tarfile`` reads as many bytes as a header says, which are all there are for a negative size; it follows a chain of
# headers that only describe the next one until its stack is full; and it looks for numbers in a time that grows with
# the square of their digits. What it raises then is not declared.
class BoundedTar:
    """An archive whose headers are read one by one.

    Attributes:
        file: What reads the entries' content.
    """

    def __init__(self, file: tarfile.TarFile, reader: "_BoundedReader") -> None:
        self.file = file
        self._reader = reader

    def headers(self) -> Iterator[tarfile.TarInfo]:
        """Yields the entries.

        Raises:
            BundleRefused: A header is none, or too big.
        """
        entries = iter(self.file)
        while True:
            with _explained(), self._reader.one_header():
                member = next(entries, None)
            if member is None:
                return
            yield member


@contextmanager
def open_tar(path: Path) -> Generator[BoundedTar]:
    """Opens a plain tar.

    Raises:
        BundleRefused: It is none.
        OSError: It cannot be read.
    """
    with path.open("rb") as file:
        _refuse_packed(file)
        with read_tar(file) as tar:
            yield tar


@contextmanager
def read_tar(file: "BinaryIO | gzip.GzipFile") -> Generator[BoundedTar]:
    """Reads a plain tar from a file that is open, front to back.

    Raises:
        BundleRefused: It is none.
    """
    reader = _BoundedReader(file)
    with _explained(), reader.one_header():
        tar = tarfile.open(fileobj=cast("IO[bytes]", reader), mode="r:")  # noqa: SIM115 - closed below
    with tar:
        yield BoundedTar(tar, reader)


def _refuse_packed(file: BinaryIO) -> None:
    """Says of what people upload most often instead of a tar archive what to do with it."""
    begin = file.read(max(map(len, _PACKED)))
    file.seek(0)
    for mark, name in _PACKED.items():
        if begin.startswith(mark):
            raise BundleRefused(f"the bundle is packed by {name}: make a plain tar archive, as tar -cf does without -z")


class _BoundedReader:
    """An archive's file, from which one header takes no more than so many bytes."""

    def __init__(self, file: "BinaryIO | gzip.GzipFile") -> None:
        self._file = file
        self._left: int | None = None

    @contextmanager
    def one_header(self) -> Generator[None]:
        """Bounds what is read in the block."""
        self._left = _HEADER_BYTES
        try:
            yield
        finally:
            self._left = None

    def read(self, size: int = -1) -> bytes:
        """Returns the next bytes; refuses more than one header may have, and numbers of thousands of digits."""
        if self._left is None:
            return self._file.read(size)
        if not 0 <= size <= self._left:
            raise BundleRefused(f"a header in the bundle is none, or has more than {_HEADER_BYTES} bytes")
        self._left -= size
        found = self._file.read(size)
        if _LONG_NUMBER.search(found):
            raise BundleRefused("a header in the bundle has a number of thousands of digits")
        return found

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Goes to a place in the file."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Returns the place in the file."""
        return self._file.tell()


@contextmanager
def _explained() -> Generator[None]:
    """Makes a refusal of whatever a header has brought about; a broken disk's error stays what it is."""
    try:
        yield
    except BundleRefused:
        raise
    except Exception as exc:
        if isinstance(exc, OSError) and exc.errno in OF_THE_DISK:
            raise
        what = f"{type(exc).__name__}: {exc}"[:_REASON_CHARACTERS]
        raise BundleRefused(f"the bundle is not a plain tar archive: {what}") from exc


@dataclass(frozen=True)
class ArchiveLimits:
    """How much an archive may hold.

    Attributes:
        total_bytes: Of all files together.
        entries: Files and directories.
        depth: Levels of directories.
    """

    total_bytes: int = 2 << 30
    entries: int = 20_000
    depth: int = 32


LIMITS = ArchiveLimits()


def digest_of(path: Path) -> str:
    """Returns the SHA-256 of a file as 64 hexadecimal digits.

    Raises:
        OSError: The file cannot be read.
    """
    with path.open("rb") as source:
        return hashlib.file_digest(source, "sha256").hexdigest()


def list_bundle_files(store: Store, digest: str) -> dict[str, bool]:
    """Returns the regular files of a bundle, and whether each can be executed; unpacks nothing.

    Raises:
        ObjectNotFound: The store has no such bundle.
        BundleRefused: It has another digest, or is not a plain tar.
    """
    return read_bundle(store, digest)[0]


def read_bundle(store: Store, digest: str, heads: Collection[str] = ()) -> tuple[dict[str, bool], dict[str, bytes]]:
    """Returns what `list_bundle_files` does, and the first bytes of some of the files, by name.

    Args:
        store: Where the bundle is.
        digest: Its SHA-256.
        heads: Which files are looked into.

    Raises:
        ObjectNotFound: The store has no such bundle.
        BundleRefused: It has another digest, or is not a plain tar.
    """
    files, begun = dict[str, bool](), dict[str, bytes]()
    with tempfile.TemporaryDirectory() as folder:
        archive = Path(folder) / "bundle"
        store.download(bundle_key(digest), archive)
        _require_digest(archive, digest)
        with open_tar(archive) as tar:
            for member in list_members(tar.headers()):
                if member.type not in _FILES:
                    continue
                files[member.name] = bool(member.mode & 0o111)
                if member.name in heads:
                    with _explained():
                        source = tar.file.extractfile(member)
                        begun[member.name] = source.read(HEAD_BYTES) if source else b""
    return files, begun


def install(
    archive: Path,
    digest: str,
    target: Path,
    *,
    limits: ArchiveLimits = LIMITS,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> None:
    """Unpacks an archive so that the folder is there whole or not at all, even when the power fails.

    Does nothing when the folder is there already: a folder gets its name only when it is complete.

    Args:
        archive: A plain tar.
        digest: The SHA-256 it must have.
        target: The folder to make; its parent exists.
        limits: How much it may hold.
        progress: Called with the bytes written so far and the size of the archive.

    Raises:
        BundleRefused: The digest is another, or the archive holds what no bundle may.
        StoreFull: This machine has no room for what it holds.
    """
    if target.is_dir():
        return
    _require_digest(archive, digest)
    temporary = target.with_name(f"{target.name}.{uuid.uuid4().hex[:8]}.tmp")
    try:
        extract(archive, temporary, limits=limits, progress=progress)
        for folder, _, _ in os.walk(temporary):
            settle_names(Path(folder))
        _rename_unless_there(temporary, target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    settle_names(target.parent)


def _require_digest(archive: Path, digest: str) -> None:
    if (found := digest_of(archive)) != digest:
        raise BundleRefused(f"the bundle has digest {found}, expected {digest}: it was changed or cut short")


def extract(
    archive: Path,
    target: Path,
    *,
    limits: ArchiveLimits = LIMITS,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> None:
    """Unpacks regular files and directories of a tar into a new folder; refuses everything else.

    Files become 0644, or 0755 when the archive has them executable. What was unpacked before a refusal is the caller's
    to remove.

    Args:
        archive: The tar.
        target: The new folder.
        limits: How much it may hold.
        progress: Told how many of how many bytes are unpacked.

    Raises:
        BundleRefused: Not a plain tar, or with a link, a device, a sparse file, a duplicate, a name outside the folder,
            or more than the limits.
        StoreFull: This machine has no room for what it holds.
        StoreAccessDenied: The disk is read-only.
        FileExistsError: The folder exists.
    """
    with room_in(target.parent):
        target.mkdir(mode=0o755)
        _unpack(archive, target, limits, progress)


def _unpack(archive: Path, target: Path, limits: ArchiveLimits, progress: Callable[[int, int], None]) -> None:
    size = archive.stat().st_size
    written = 0
    try:
        with open_tar(archive) as tar:
            for member in list_members(tar.headers(), limits):
                written += _write_member(tar.file, member, target, limits)
                progress(written, size)
    except tarfile.TarError as exc:
        raise BundleRefused(f"the bundle is not a plain tar archive: {exc}") from exc
    except (OSError, UnicodeError) as exc:
        if isinstance(exc, OSError) and exc.errno in OF_THE_DISK:
            raise
        raise BundleRefused(f"the bundle cannot be unpacked: {exc}") from exc


def list_members(headers: Iterable[tarfile.TarInfo], limits: ArchiveLimits = LIMITS) -> Iterator[tarfile.TarInfo]:
    """Yields the entries of an archive, and no more than it may hold.

    Who packs a folder as ``tar -cf bundle.tar .`` has the folder itself among them, and ``./`` before every name; that
    is the same bundle, so the one is left out and the other is left off.

    Raises:
        BundleRefused: It holds more.
    """
    total_bytes = 0
    for count, member in enumerate(headers, start=1):
        if count > limits.entries:
            raise BundleRefused(f"the bundle holds more than {limits.entries} entries")
        if member.size < 0:
            raise BundleRefused(f"{member.name!r} in the bundle has a negative size")
        total_bytes += member.size
        if total_bytes > limits.total_bytes:
            raise BundleRefused(f"the bundle unpacks to more than {limits.total_bytes} bytes")
        if member.type == tarfile.DIRTYPE and member.name.rstrip("/") == ".":
            continue
        member.name = member.name.removeprefix("./")
        yield member


def _write_member(tar: tarfile.TarFile, member: tarfile.TarInfo, target: Path, limits: ArchiveLimits) -> int:
    """Returns how many bytes were written for one entry."""
    path = target.joinpath(*safe_parts(member.name, limits.depth))
    with place_of_its_own(member.name):
        if member.type == tarfile.DIRTYPE:
            path.mkdir(mode=0o755, parents=True, exist_ok=True)
            return 0
        if member.type not in _FILES or member.issparse():
            raise BundleRefused(f"{member.name!r} in the bundle is neither a regular file nor a directory")
        path.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
        _write_file(tar, member, path)
    return member.size


@contextmanager
def place_of_its_own(name: str) -> Generator[None]:
    """Refuses an archive's entry in whose place another one is, inside the ``with`` block that writes it.

    Raises:
        BundleRefused: It is there twice, or as a file and as a folder.
    """
    try:
        yield
    except (FileExistsError, NotADirectoryError, IsADirectoryError) as exc:
        raise BundleRefused(f"{name!r} is in the archive twice, or a file's name is a folder's as well") from exc


def _write_file(tar: tarfile.TarFile, member: tarfile.TarInfo, path: Path) -> None:
    source = tar.extractfile(member)
    if source is None:
        raise BundleRefused(f"{member.name!r} in the bundle has no content")
    descriptor = os.open(path, _CREATE, 0o755 if member.mode & 0o111 else 0o644)
    with os.fdopen(descriptor, "wb") as sink:
        shutil.copyfileobj(source, sink, _BLOCK_BYTES)
        if sink.tell() != member.size:
            raise BundleRefused(f"{member.name!r} in the bundle is cut short")
        flush_to_disk(sink)


def safe_parts(name: str, depth: int = LIMITS.depth) -> tuple[str, ...]:
    """Returns the parts of a relative path that stays below where it starts.

    Raises:
        BundleRefused: Absolute, climbing, empty, too deep, or with characters that no file name of a bundle needs.
    """
    parts = tuple(name.removesuffix("/").split("/"))
    climbing = any(part in {"", ".", ".."} for part in parts)
    unsafe = any(not part.isprintable() or "\\" in part or len(part.encode()) > _NAME_BYTES for part in parts)
    if climbing or unsafe or len(parts) > depth:
        raise BundleRefused(f"{name!r} in the bundle is no relative path below the bundle's folder")
    return PurePosixPath(*parts).parts


def _rename_unless_there(temporary: Path, target: Path) -> None:
    try:
        temporary.rename(target)
    except OSError:
        # Renaming onto a folder with content fails: another process was first, with the same bytes.
        if not target.is_dir():
            raise
