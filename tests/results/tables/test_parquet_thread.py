"""A thread appends rows in their order, to the end or to its first error."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tasks.results.tables import parquet
from tasks.results.tables.parquet import ParquetFile, parquet_thread

SCHEMA = pa.schema([pa.field("row", pa.int64())])


def rows(first: int) -> pa.Table:
    return pa.table({"row": [first, first + 1]}, schema=SCHEMA)


def write(path: Path, tables: Iterable[pa.Table]) -> None:
    with ParquetFile(path, SCHEMA) as file, parquet_thread(file) as add:
        for table in tables:
            add(table)


def test_rows_come_in_the_order_in_which_they_were_appended(tmp_path: Path):
    write(tmp_path / "rows.parquet", (rows(2 * number) for number in range(50)))
    assert pq.read_table(tmp_path / "rows.parquet").column("row").to_pylist() == list(range(100))


def test_what_the_thread_cannot_write_ends_the_block(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(parquet, "ROW_GROUP_ROWS", 2)
    left = iter(range(50))
    with pytest.raises(ValueError, match="schema"):
        write(tmp_path / "rows.parquet", (pa.table({"word": [str(number), ""]}) for number in left))
    assert next(left) < 10


def test_an_error_of_the_block_is_raised_and_not_the_threads(tmp_path: Path):
    def tables() -> Iterator[pa.Table]:
        yield pa.table({"word": ["a"]})
        raise KeyError("chunk")

    with pytest.raises(KeyError, match="chunk"):
        write(tmp_path / "rows.parquet", tables())
