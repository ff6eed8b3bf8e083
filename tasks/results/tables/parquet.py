"""Writes Parquet files whose bytes depend on the rows and the metadata alone, however the rows came."""

import hashlib
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

import pyarrow as pa
import pyarrow.parquet as pq

# So many rows of failures with long trajectories are some 30 MB in memory, and of results some 3 MB.
ROW_GROUP_ROWS = 8_192
_BLOCK_BYTES = 1 << 20


class ParquetFile:
    """A file that is written piece by piece, and holds one row group at most in memory.

    Row groups have a fixed size however the pieces fall, compression is zstd, columns that repeat their values are
    dictionary encoded, every column has statistics. The only other thing that the bytes depend on is the version of
    pyarrow, which Parquet's footer names.
    """

    def __init__(
        self,
        path: Path,
        schema: pa.Schema,
        metadata: Mapping[str, str] | None = None,
        *,
        dictionary: Sequence[str] | None = None,
        level: int = 3,
    ) -> None:
        """Begins the file.

        Args:
            path: A local file, overwritten.
            schema: Its metadata goes into the footer too.
            metadata: More for the footer, such as engine and versions; no times, no paths.
            dictionary: Columns in which values are repeated; all if None. Numbers that hardly are cost five times the
                time and half as much space again with one.
            level: Of zstd. Of numbers that hardly repeat, 3 takes a third more time than 1 for a tenth less space.
        """
        footer = {**_text(schema.metadata), **(metadata or {})}
        self._schema = schema.with_metadata(dict(sorted(footer.items())))
        self._waiting: list[pa.Table] = []
        self._rows = 0
        self._hashed = hashlib.sha256()
        self._writer = pq.ParquetWriter(
            path,
            self._schema,
            version="2.6",
            data_page_version="1.0",  # every reader has it
            compression="zstd",
            compression_level=level,
            use_dictionary=True if dictionary is None else list(dictionary),  # pyright: ignore[reportArgumentType] - stubs
            write_statistics=True,
        )
        self._written = path.open("rb")

    def add(self, table: pa.Table) -> None:
        """Appends rows.

        Args:
            table: With the columns of the schema.
        """
        if table.num_rows:
            self._waiting.append(table.replace_schema_metadata(self._schema.metadata))
            self._rows += table.num_rows
        while self._rows >= ROW_GROUP_ROWS:
            self._write(ROW_GROUP_ROWS)

    def note(self, metadata: Mapping[str, str]) -> None:
        """Adds metadata to the footer that is known only when the rows are; in the order of its keys."""
        self._writer.add_key_value_metadata(dict(sorted(metadata.items())))

    def hash(self) -> None:
        """Hashes what was written since the last time, so that `sha256` has less left to read."""
        while block := self._written.read(_BLOCK_BYTES):
            self._hashed.update(block)

    def sha256(self) -> str:
        """Returns the SHA-256 of the file, which is whole then."""
        self._close()
        self.hash()
        return self._hashed.hexdigest()

    def _close(self) -> None:
        if self._writer.is_open:
            if self._rows:
                self._write(self._rows)
            self._writer.close()

    def _write(self, rows: int) -> None:
        whole = pa.concat_tables(self._waiting)
        self._writer.write_table(whole.slice(0, rows), row_group_size=rows)
        self._rows -= rows
        self._waiting = [whole.slice(rows)] if self._rows else []

    def __enter__(self) -> Self:
        """Returns the file."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Closes the file; rows that wait are left out of one whose block fails, for nobody reads it."""
        if error is not None:
            self._waiting, self._rows = [], 0
        with self._written:
            self._close()


def write_parquet(table: pa.Table, path: Path, metadata: Mapping[str, str] | None = None) -> str:
    """Writes a table that is there as a whole, and returns the file's SHA-256; see `ParquetFile`."""
    with ParquetFile(path, table.schema, metadata) as file:
        file.add(table)
        return file.sha256()


def _text(metadata: Mapping[bytes, bytes] | None) -> dict[str, str]:
    return {key.decode(): value.decode() for key, value in (metadata or {}).items()}


# One is written while one waits; more would only hold memory.
_TABLES = 2


@contextmanager
def parquet_thread(file: ParquetFile) -> Generator[Callable[[pa.Table], None]]:
    """Gives what appends rows to a file, in their order, and returns before they are written.

    At the end of the ``with`` block all are, or the thread's error is raised; of a block that fails no more are. Who
    appends waits while two tables are not written yet.

    Args:
        file: Nobody else writes to it inside the block.

    Raises:
        OSError: The file could not be written: out of the append that comes next but one at the latest.
    """
    thread = ThreadPoolExecutor(1)
    begun: deque[Future[None]] = deque()

    def add(table: pa.Table) -> None:
        while len(begun) >= _TABLES:
            begun.popleft().result()
        begun.append(thread.submit(_write, file, table))

    try:
        yield add
        while begun:
            begun.popleft().result()
    finally:
        thread.shutdown(cancel_futures=True)


def _write(file: ParquetFile, table: pa.Table) -> None:
    file.add(table)
    file.hash()
