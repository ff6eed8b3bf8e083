"""A store of arrays: in memory up to a size, beyond it in one unnamed file.

One file, however many arrays: each file mapped into memory costs a file descriptor, and a usual limit is 1,024.
"""

import tempfile
import weakref
from typing import IO, NamedTuple

import numpy as np


class Kept(NamedTuple):
    """An array that was kept.

    Attributes:
        array: The array, if it is in memory.
        offset: Where it begins in the file, if it is there.
    """

    array: np.ndarray | None
    dtype: np.dtype
    shape: tuple[int, ...]
    offset: int = 0

    @property
    def row_bytes(self) -> int:
        """Returns the bytes of one entry along its first axis."""
        return int(np.prod(self.shape[1:], dtype=np.int64)) * self.dtype.itemsize


class Overflow:
    """Keeps arrays."""

    def __init__(self, memory_bytes: int) -> None:
        """Begins with none.

        Args:
            memory_bytes: How much may stay in memory.
        """
        self._left_bytes = memory_bytes
        self._file: IO[bytes] | None = None
        self._written_bytes = 0
        self._mapped: np.ndarray | None = None

    def keep(self, array: np.ndarray) -> Kept:
        """Returns what to ask for the array with later."""
        whole = np.ascontiguousarray(array)
        if whole.nbytes <= self._left_bytes:
            self._left_bytes -= whole.nbytes
            return Kept(whole, whole.dtype, whole.shape)
        self._left_bytes = 0  # what comes later is not put before it
        if self._file is None:
            self._file = tempfile.TemporaryFile(prefix="simyard-recording-")  # noqa: SIM115 - closed with this
            weakref.finalize(self, self._file.close)
        offset = self._written_bytes
        self._file.write(whole.data if whole.size else b"")
        self._written_bytes += whole.nbytes
        self._mapped = None
        return Kept(None, whole.dtype, whole.shape, offset)

    def get(self, kept: Kept) -> np.ndarray:
        """Returns an array that was kept; it must not be written to."""
        if kept.array is not None:
            return kept.array
        count = int(np.prod(kept.shape, dtype=np.int64))
        if not count or self._file is None:
            return np.empty(kept.shape, kept.dtype)
        if self._mapped is None:
            self._file.flush()
            self._mapped = np.memmap(self._file, np.uint8, "r")
        held = self._mapped[kept.offset : kept.offset + count * kept.dtype.itemsize]
        return held.view(kept.dtype).reshape(kept.shape)
