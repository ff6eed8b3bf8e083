"""Unpacks archives of data sources without trusting what is inside."""

import errno
import gzip
import lzma
import shutil
import tempfile
import zipfile
import zlib
from pathlib import Path

from specs.errors import BundleRefused
from tasks.simulate.data.sources import MOST_BYTES
from tasks.storage.archives import ArchiveLimits, extract, safe_parts

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
