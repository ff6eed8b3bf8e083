"""Unpacked bundles on this machine, used only while they hold what their digest says: in the cache, and on a robot.

In the cache:

<digest>/bundle.tar    the archive, whose SHA-256 is the digest
<digest>/files         what it holds, read-only

An application that runs as the account that simulates can write into all of this, and whatever note lay beside it could
be written anew. So the seal is the archive itself: before each use it is read once more, is compared with the files
byte by byte on the way, and has to have the digest in the end. What differs is unpacked anew.
"""

import hashlib
import io
import os
import shutil
import stat
import tarfile
import uuid
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO

from specs.errors import BundleRefused
from tasks.storage.archives import digest_of, extract, list_members, safe_parts
from tasks.storage.base.local_files import flush_to_disk, settle_names

FILES_FOLDER = "files"
_ARCHIVE = "bundle.tar"
_FILE, _SCRIPT, _FOLDER = 0o444, 0o555, 0o555
_BLOCK_BYTES = 1 << 20
SHIPPED_HOMES = (
    Path(__file__).parents[1] / "applications" / "shipped",  # in a wheel
    Path(__file__).parents[2] / "applications",  # in the repository
)
"""Folders of the applications that come with Simyard."""
LEFT_OUT = frozenset({"__pycache__", ".git", ".DS_Store"})
"""Names that no bundle has: left by editors, interpreters and version control, and different on every machine."""


_OPEN = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC  # a pipe in the place of a file must not hold up
# None for a folder, else whether the file can be executed.
_Entries = dict[str, bool | None]


def sealed_files(entry: Path, digest: str) -> Path | None:
    """Returns the folder of a bundle's files; None if it is not there, or holds anything but what the bundle holds.

    Costs one reading of the archive and one of the files: 0.6 ms for the shipped courier, 0.2 s for 100 MB.

    Args:
        entry: What ``seal`` made.
        digest: SHA-256 of the bundle.
    """
    return entry / FILES_FOLDER if _is_intact(entry, digest) else None


def changed_bundle(files: Path) -> bool:
    """Returns whether a folder that ``seal`` gave holds anything but its bundle any more.

    Args:
        files: ``<digest>/files``.
    """
    return not _is_intact(files.parent, files.parent.name)


def is_shipped(files: Path) -> bool:
    """Returns whether a bundle's folder holds what an application does that comes with Simyard, and nothing else."""
    shipped = (path for home in SHIPPED_HOMES if home.is_dir() for path in home.iterdir() if path.is_dir())
    sizes = _sizes(files)
    return bool(sizes) and any(_sizes(each) == sizes and _have_same(each, files, sizes) for each in shipped)


def _sizes(folder: Path) -> dict[str, int]:
    """Returns how long each file below a folder is, by its name; -1 of a link, which no bundle has."""
    paths = ((path.relative_to(folder), path) for path in folder.rglob("*") if path.is_file() or path.is_symlink())
    return {
        str(name): -1 if path.is_symlink() else path.stat().st_size
        for name, path in paths
        if not LEFT_OUT.intersection(name.parts)
    }


def _have_same(one: Path, other: Path, names: Iterable[str]) -> bool:
    """Returns whether files in two folders are the same; only what is as long as what is shipped is read."""
    files = ((one / name, other / name) for name in names)
    return all(not a.is_symlink() and a.read_bytes() == b.read_bytes() for a, b in files)


def holds_bundle(files: Path, archive: Path, digest: str) -> bool:
    """Returns whether a folder holds all of a bundle, as the bundle has it; more may lie beside that.

    Costs two readings of the archive and one of the files: 0.3 s for 100 MB.

    Args:
        files: Where the bundle was unpacked.
        archive: What it was unpacked from.
        digest: SHA-256 of the bundle.
    """
    try:
        if digest_of(archive) != digest:
            return False
        with tarfile.open(archive, "r:") as tar:
            expected = _same_entries(tar, files)
        return expected is not None and all(_kind(files / name) == kind for name, kind in expected.items())
    except (OSError, tarfile.TarError, BundleRefused):
        return False


def bundle_entries(folder: Path) -> Iterator[tuple[Path, str]]:
    """Yields everything in a folder as path and name in its archive, in one order on every machine."""
    with os.scandir(folder) as scanned:
        children = sorted(Path(entry.path) for entry in scanned if entry.name not in LEFT_OUT)
    for child in children:
        yield child, child.name
        if child.is_dir() and not child.is_symlink():
            for path, name in bundle_entries(child):
                yield path, f"{child.name}/{name}"


def write_archive(entries: Iterable[tuple[Path, str]], target: IO[bytes]) -> None:
    """Writes files and folders as a plain tar: without owners or times, with only the executable bit of the modes."""
    with tarfile.open(fileobj=target, mode="w", format=tarfile.PAX_FORMAT) as tar:
        for path, name in entries:
            if path.is_dir():
                tar.addfile(_header(name, tarfile.DIRTYPE, 0o755, 0))
                continue
            status = path.stat()
            mode = 0o755 if status.st_mode & stat.S_IXUSR else 0o644
            with path.open("rb") as body:
                tar.addfile(_header(name, tarfile.REGTYPE, mode, status.st_size), body)


def _header(name: str, type_: bytes, mode: int, size: int) -> tarfile.TarInfo:
    header = tarfile.TarInfo(name)  # owner 0, time 0, no names
    header.type, header.mode, header.size = type_, mode, size
    return header


def repack_bundle(files: Path, archive: Path, digest: str) -> bool:
    """Returns whether an archive that is lost was made again from what was unpacked of it, with the digest that it had.

    That works for a bundle that Simyard packed, of which every byte is there and nothing was added.

    Args:
        files: Where the bundle was unpacked.
        archive: Where the archive is to lie.
        digest: SHA-256 of the bundle.
    """
    made = archive.with_name(f".{digest}.repacked")
    try:
        entries = list(bundle_entries(files))
        for path, _ in entries:
            _kind(path)
        with made.open("xb") as file:
            write_archive(entries, file)
            flush_to_disk(file)
        if digest_of(made) != digest:
            return False
        made.replace(archive)
        settle_names(archive.parent)
    except (OSError, BundleRefused):  # it is to be fetched
        return False
    finally:
        made.unlink(missing_ok=True)
    return True


def _kind(path: Path) -> bool | None:
    """Returns what stands of an entry in the archive: None for a folder, else whether it can be executed."""
    mode = path.lstat().st_mode
    if not stat.S_ISDIR(mode) and not stat.S_ISREG(mode):
        raise BundleRefused(f"{path} is neither a file nor a folder")
    return None if stat.S_ISDIR(mode) else bool(mode & stat.S_IXUSR)


def seal_bundle(archive: Path, entry: Path, digest: str) -> Path:
    """Returns the folder of a bundle's files, unpacked from an archive, read-only, whole or not at all.

    Args:
        archive: A plain tar; moved.
        entry: Where it is to be: ``<cache>/<digest>``; what lies there and was changed is put away.
        digest: The SHA-256 that the archive must have.

    Raises:
        BundleRefused: The digest is another, or the archive holds what no bundle may.
        StoreFull: This machine has no room for what it holds.
    """
    if (found := digest_of(archive)) != digest:
        raise BundleRefused(f"the bundle has digest {found}, expected {digest}: it was changed or cut short")
    staged = _beside(entry)
    staged.mkdir(parents=True)
    try:
        archive.rename(staged / _ARCHIVE)
        extract(staged / _ARCHIVE, staged / FILES_FOLDER)
        _close(staged)
        if not _is_intact(staged, digest):
            raise BundleRefused(f"the bundle {digest} was changed while it was unpacked")
        _install(staged, entry, digest)
    finally:
        discard_bundle(staged)
    return entry / FILES_FOLDER


def stored_archive(entry: Path, digest: str) -> Path | None:
    """Returns the archive beside files that were changed, if it is still the bundle; None if there is none."""
    archive = entry / _ARCHIVE
    try:
        return archive if digest_of(archive) == digest else None
    except OSError:
        return None


def discard_bundle(folder: Path) -> None:
    """Removes a folder whose own folders may be read-only."""
    for base, _, _ in os.walk(folder):
        Path(base).chmod(0o755)
    shutil.rmtree(folder, ignore_errors=True)


def _install(staged: Path, entry: Path, digest: str) -> None:
    if entry.exists() and not _is_intact(entry, digest):
        away = _beside(entry)
        try:
            entry.rename(away)
        except FileNotFoundError:  # another process has put it away
            pass
        else:
            discard_bundle(away)
    try:
        staged.rename(entry)
    except OSError:
        # Renaming onto a folder with content fails: another process was first, with the same bytes.
        if not _is_intact(entry, digest):
            raise
    settle_names(entry.parent)


def _beside(entry: Path) -> Path:
    return entry.with_name(f".{entry.name}.{uuid.uuid4().hex[:8]}.tmp")


def _close(staged: Path) -> None:
    """Takes the right to write from everything that was unpacked."""
    for base, _, names in os.walk(staged, topdown=False):
        for name in names:
            path = Path(base, name)
            path.chmod(_SCRIPT if path.stat().st_mode & stat.S_IXUSR else _FILE)
        settle_names(Path(base))
        if Path(base) != staged:
            Path(base).chmod(_FOLDER)


def _is_intact(entry: Path, digest: str) -> bool:
    """Returns whether the archive has the digest, and the files are those of the archive and no others."""
    try:
        with (entry / _ARCHIVE).open("rb") as file:
            reader = _DigestReader(file)
            with tarfile.open(fileobj=reader, mode="r|") as tar:
                expected = _same_entries(tar, entry / FILES_FOLDER)
            reader.drain()
        return expected is not None and reader.digest() == digest and _entries(entry / FILES_FOLDER) == expected
    except (OSError, tarfile.TarError, BundleRefused):
        return False


class _DigestReader(io.RawIOBase):
    """A file, and the SHA-256 of all that was read from it: what is compared is what is hashed."""

    def __init__(self, file: IO[bytes]) -> None:
        super().__init__()
        self._file, self._sum = file, hashlib.sha256()

    def read(self, size: int = -1, /) -> bytes:
        block = self._file.read(size)
        self._sum.update(block)
        return block

    def drain(self) -> None:
        while self.read(_BLOCK_BYTES):
            pass

    def digest(self) -> str:
        return self._sum.hexdigest()


def _same_entries(tar: tarfile.TarFile, files: Path) -> _Entries | None:
    """Returns the entries of an archive, with the folders that its names imply; None if a file has other content."""
    found: _Entries = {".": None}
    for member in list_members(tar):
        parts = safe_parts(member.name)
        found.update({"/".join(parts[:depth]): None for depth in range(1, len(parts))})
        if member.isdir():
            found["/".join(parts)] = None
            continue
        source = tar.extractfile(member)
        if source is None or not _same_content(source, files.joinpath(*parts)):
            return None
        found["/".join(parts)] = bool(member.mode & 0o111)
    return found


def _same_content(source: IO[bytes], path: Path) -> bool:
    with os.fdopen(os.open(path, _OPEN), "rb") as file:
        while block := source.read(_BLOCK_BYTES):
            if file.read(len(block)) != block:
                return False
        return not file.read(1)


def _entries(files: Path) -> _Entries | None:
    """Returns what lies in a folder; None if anything there is a link, a device, or has been given other rights."""
    found: _Entries = {}
    for base, folders, names in os.walk(files):
        for path in (Path(base), *(Path(base, name) for name in (*folders, *names))):
            status = path.lstat()
            mode = stat.S_IMODE(status.st_mode)
            folder, file = stat.S_ISDIR(status.st_mode), stat.S_ISREG(status.st_mode)
            if not (folder and mode == _FOLDER) and not (file and mode in {_FILE, _SCRIPT}):
                return None
            found[path.relative_to(files).as_posix()] = None if folder else mode == _SCRIPT
    return found
