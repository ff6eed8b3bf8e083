"""Appends rows to a Parquet file in a thread of its own: what encodes, compresses and hashes needs no interpreter."""

from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager

import pyarrow as pa

from tasks.results.tables.parquet import ParquetFile

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
