"""A bundle's folder as an archive with the same bytes wherever and whenever it is packed."""

import io
import os
import stat
import tarfile
from collections.abc import Iterator
from pathlib import Path

from specs.base import Fault
from specs.errors import BundleRefused, DocumentError
from tasks.storage.archives import LIMITS, safe_parts

# Left by editors, interpreters and version control, and different on every machine.
_LEFT_OUT = frozenset({"__pycache__", ".git", ".DS_Store"})


def pack(folder: Path) -> bytes:
    """Returns the folder as a plain tar: sorted, without owners or times, with only the executable bit of the modes.

    Hidden leavings of tools (``__pycache__``, ``.git``, ``.DS_Store``) are left out.

    Args:
        folder: Holds regular files and directories only, at least one file.

    Raises:
        DocumentError: No such folder, no file in it, a link or device, or a name that could not be unpacked safely.
    """
    entries = list(_entries(folder)) if folder.is_dir() else []
    faults = [fault for path, name in entries if (fault := _fault(path, name))]
    if not folder.is_dir():
        faults = [Fault(path="source", value=str(folder), allowed="a folder that exists")]
    elif not any(path.is_file() for path, _ in entries):
        faults = [Fault(path="source", value=str(folder), allowed="a folder with at least one file"), *faults]
    if faults:
        raise DocumentError(faults, source=f"bundle {folder}")
    return _archive(entries)


def _archive(entries: list[tuple[Path, str]]) -> bytes:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.PAX_FORMAT) as tar:
        for path, name in entries:
            if path.is_dir():
                tar.addfile(_header(name, tarfile.DIRTYPE, 0o755, 0))
                continue
            body = path.read_bytes()
            mode = 0o755 if path.stat().st_mode & stat.S_IXUSR else 0o644
            tar.addfile(_header(name, tarfile.REGTYPE, mode, len(body)), io.BytesIO(body))
    return buffer.getvalue()


def _header(name: str, type_: bytes, mode: int, size: int) -> tarfile.TarInfo:
    header = tarfile.TarInfo(name)  # owner 0, time 0, no names
    header.type, header.mode, header.size = type_, mode, size
    return header


def _entries(folder: Path) -> Iterator[tuple[Path, str]]:
    """Yields everything in the folder as path and name in the archive, in one order on every machine."""
    with os.scandir(folder) as scanned:
        children = sorted(Path(entry.path) for entry in scanned if entry.name not in _LEFT_OUT)
    for child in children:
        yield child, child.name
        if child.is_dir() and not child.is_symlink():
            for path, name in _entries(child):
                yield path, f"{child.name}/{name}"


def _fault(path: Path, name: str) -> Fault | None:
    mode = path.lstat().st_mode
    if stat.S_ISLNK(mode):
        return Fault(path=name, value="symbolic link", allowed="regular files and directories; copy what it points to")
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        return Fault(path=name, value="device, socket or pipe", allowed="regular files and directories")
    try:
        safe_parts(name)
    except BundleRefused:
        return Fault(path=name, value="its name", allowed=f"printable characters, at most {LIMITS.depth} levels deep")
    return None
