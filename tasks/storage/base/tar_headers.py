"""The headers of a tar archive that anybody may have written, each read from a bounded number of bytes.

``tarfile`` reads as many bytes as a header says, which are all there are for a negative size; it follows a chain of
headers that only describe the next one until its stack is full; and it looks for numbers in a time that grows with the
square of their digits. What it raises then is not declared.
"""

import os
import re
import tarfile
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, BinaryIO, cast

from specs.errors import BundleRefused
from tasks.storage.base.disk_space import OF_THE_DISK

# Of one entry: its name, up to 32 levels of 255 bytes, and what else a header of PAX holds.
_HEADER_BYTES = 1 << 15
_LONG_NUMBER = re.compile(rb"[0-9]{1024}")
_REASON_CHARACTERS = 200
_PACKED = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"\x28\xb5\x2f\xfd": "zstd", b"PK\x03\x04": "zip"}
"""How a file begins that is packed, and by what."""


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

    def __init__(self, file: BinaryIO) -> None:
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
