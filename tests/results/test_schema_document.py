"""docs/results-schema.md says what the code does: every column, and queries that run."""

import html
import re
from pathlib import Path

import duckdb
import pyarrow as pa
import pytest

from tasks.results.parquet import write_parquet
from tasks.results.schema import FAILURES, RESULTS, SCHEMA_VERSION
from tasks.results.tables import failures_table, results_table
from tests.episodes_factory import batch, request

DOCUMENT = (Path(__file__).parents[2] / "docs" / "results-schema.md").read_text()
QUERIES = re.findall(r"```sql\n(.*?)```", DOCUMENT, re.DOTALL)


def documented(heading: str) -> list[list[str]]:
    section = DOCUMENT.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    rows = [line for line in section.split("\n") if line.startswith("| `")]
    return [[html.unescape(cell.strip()) for cell in row.strip("|").split("|")] for row in rows]


def described(field: pa.Field) -> list[str]:
    metadata = field.metadata or {}
    null = ", null" if field.nullable else ""
    return [
        f"`{field.name}`",
        f"{field.type}{null}",
        metadata[b"unit"].decode() or "-",
        metadata[b"description"].decode(),
    ]


def test_every_column_of_the_results_is_documented():
    assert documented("results.parquet") == [described(field) for field in RESULTS]


def test_every_further_column_of_the_failures_is_documented():
    further = [field for field in FAILURES if field.name not in RESULTS.names]
    assert documented("failures.parquet") == [described(field) for field in further]


def test_the_version_is_documented():
    assert f"version {SCHEMA_VERSION} of their schema" in DOCUMENT


@pytest.mark.parametrize("sql", QUERIES)
def test_the_queries_of_the_document_run(sql: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    requests = [request(index, environment={"MAX_SPEED": "0.3"}) for index in range(6)]
    write_parquet(results_table("simb-1", requests, batch(3, 2, 1)), tmp_path / "results.parquet")
    write_parquet(failures_table("simb-1", requests, batch(3, 2, 1)), tmp_path / "failures.parquet")
    monkeypatch.chdir(tmp_path)
    with duckdb.connect() as connection:
        assert connection.execute(sql).fetchall()


def test_there_are_queries():
    assert len(QUERIES) == 4
