"""Parquet files: what was written is read back, by pyarrow and by DuckDB, and the same table is the same bytes."""

import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from specs.data.episode import EpisodeRequest, EpisodeResult
from tasks.results.tables import parquet
from tasks.results.tables.episode_tables import failures_table, results_table
from tasks.results.tables.parquet import ParquetFile, parquet_thread, write_parquet
from tests.factories.episodes import collided, crashed, episodes, passed, request


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("parquet")


@pytest.fixture(scope="module")
def written(folder: Path) -> Path:
    requests = [
        request(index, world=f"wgj-1/world-{index % 2}-1", environment={"MAX_SPEED": "0.3" if index < 4 else "0.6"})
        for index in range(8)
    ]
    results = [passed(index) for index in range(6)] + [collided(6), crashed(7)]
    swept = ["MAX_SPEED"]
    write_parquet(results_table("simb-1", requests, results, swept), folder / "results.parquet")
    write_parquet(failures_table("simb-1", requests, results, swept), folder / "failures.parquet")
    return folder


@given(episodes())
def test_tables_come_back_as_they_were(folder: Path, drawn: tuple[list[EpisodeRequest], list[EpisodeResult]]):
    for make in (results_table, failures_table):
        table = make("simb-1", *drawn)
        write_parquet(table, folder / "round.parquet")
        back = pq.read_table(folder / "round.parquet")
        assert back.equals(table)
        assert [field.metadata for field in back.schema] == [field.metadata for field in table.schema]
        assert back.schema.metadata == table.schema.metadata


@given(episodes())
def test_the_same_episodes_give_the_same_bytes(folder: Path, drawn: tuple[list[EpisodeRequest], list[EpisodeResult]]):
    first = write_parquet(results_table("b", *drawn), folder / "first.parquet", {"engine": "mjx", "a": "1"})
    second = write_parquet(results_table("b", *drawn), folder / "second.parquet", {"a": "1", "engine": "mjx"})
    assert first == second
    assert (folder / "first.parquet").read_bytes() == (folder / "second.parquet").read_bytes()


@settings(
    max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture]
)  # the group size is the same for all examples
@given(sizes=st.lists(st.integers(0, 5), max_size=8))
def test_however_the_rows_come_the_bytes_are_the_same(folder: Path, sizes: list[int], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(parquet, "ROW_GROUP_ROWS", 4)
    count = sum(sizes)
    whole = results_table("b", [request(index) for index in range(count)], [passed(index) for index in range(count)])
    digest = write_parquet(whole, folder / "whole.parquet")
    with ParquetFile(folder / "pieces.parquet", whole.schema) as file:
        for start, size in zip(itertools.accumulate(sizes, initial=0), sizes, strict=False):
            file.add(whole.slice(start, size))
        assert file.sha256() == digest
    groups = pq.ParquetFile(folder / "pieces.parquet").metadata
    assert [groups.row_group(k).num_rows for k in range(groups.num_row_groups)][:-1] == [4] * (-(-count // 4) - 1)
    assert pq.read_table(folder / "pieces.parquet").num_rows == count


def test_the_footer_holds_what_was_passed_in_beside_the_schema_version(folder: Path):
    write_parquet(results_table("b", [], []), folder / "footer.parquet", {"engine": "mjx"})
    metadata = pq.read_table(folder / "footer.parquet").schema.metadata or {}
    assert metadata[b"engine"] == b"mjx"
    assert metadata[b"simyard.table"] == b"results"


def test_columns_are_compressed_with_statistics(written: Path):
    chunk = pq.ParquetFile(written / "results.parquet").metadata.row_group(0).column(2)
    assert (chunk.path_in_schema, chunk.compression, chunk.statistics.max) == ("index", "ZSTD", 7)


def query(sql: str, folder: Path) -> list[tuple[object, ...]]:
    with duckdb.connect() as connection:
        return connection.execute(sql.format(folder=folder)).fetchall()


def test_duckdb_counts_successes_by_swept_value(written: Path):
    sql = """SELECT env_MAX_SPEED, count(*), avg(success::INT) FROM '{folder}/results.parquet' GROUP BY 1 ORDER BY 1"""
    assert query(sql, written) == [(0.3, 4, 1.0), (0.6, 4, 0.5)]


def test_duckdb_reads_the_environment_by_name(written: Path):
    sql = """SELECT DISTINCT environment['MAX_SPEED'] FROM '{folder}/results.parquet' ORDER BY 1"""
    assert query(sql, written) == [("0.3",), ("0.6",)]


def test_duckdb_joins_failures_to_their_reasons_and_last_positions(written: Path):
    sql = """SELECT r.index, f.reason, f.trajectory_x_m[-1]
             FROM '{folder}/results.parquet' r JOIN '{folder}/failures.parquet' f USING (job) ORDER BY 1"""
    assert query(sql, written) == [(6, "collision", 0.6), (7, "RobotApplicationCrash", None)]


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
