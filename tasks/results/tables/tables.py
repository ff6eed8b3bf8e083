"""Makes Arrow tables of episodes: nothing in them depends on the store, the machine or the hour.

The columns are those of ``specs.data.result_columns``, and one more for each environment variable that is a number
everywhere (`sweep_variables`).
"""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pyarrow as pa

from specs.data.cells import Cells
from specs.data.episode import EpisodeRequest, EpisodeResult, success
from specs.data.episode_columns import EpisodeColumns, RequestColumns, pair_columns
from specs.data.result_columns import (
    FAILURES_COLUMNS,
    RESULTS_COLUMNS,
    SCHEMA_VERSION,
    BatchColumns,
    Column,
    ColumnType,
)
from tasks.results.tables.arrow_arrays import arrow_array, arrow_mask

SWEEP_PREFIX = "env_"
_ARROW_TYPES: Mapping[ColumnType, pa.DataType] = {
    "string": pa.string(),
    "int32": pa.int32(),
    "int64": pa.int64(),
    "double": pa.float64(),
    "bool": pa.bool_(),
    "list<double>": pa.list_(pa.float64()),
    "list<string>": pa.list_(pa.string()),
    "map<string, double>": pa.map_(pa.string(), pa.float64()),
    "map<string, string>": pa.map_(pa.string(), pa.string()),
}


Requests = Sequence[EpisodeRequest] | RequestColumns
Results = Sequence[EpisodeResult] | EpisodeColumns


def results_table(batch_id: str, requests: Requests, results: Results, variables: Sequence[str] = ()) -> pa.Table:
    """Returns a row an episode in the order of their indices, with the columns of ``RESULTS`` and the sweep's.

    Args:
        batch_id: The batch.
        requests: Episodes of it.
        results: One for each request, in any order.
        variables: Environment variables that get a column of their own (`sweep_variables`).

    Raises:
        ValueError: The requests and results do not pair up.
    """
    return both_tables(batch_id, requests, results, variables)[0]


def failures_table(batch_id: str, requests: Requests, results: Results, variables: Sequence[str] = ()) -> pa.Table:
    """Returns a row an episode that did not pass (canceled ones apart), with the columns of ``FAILURES``.

    Args:
        batch_id: The batch.
        requests: Episodes of it.
        results: One for each request, in any order.
        variables: As for `results_table`.

    Raises:
        ValueError: The requests and results do not pair up.
    """
    return both_tables(batch_id, requests, results, variables)[1]


def both_tables(
    batch_id: str, requests: Requests, results: Results, variables: Sequence[str] = ()
) -> tuple[pa.Table, pa.Table]:
    """Returns the rows of results and of failures; see `results_table` and `failures_table`.

    Raises:
        ValueError: The requests and results do not pair up.
    """
    episodes = BatchColumns(batch_id, *pair_columns(requests, results))
    columns, schemas = (*FAILURES_COLUMNS, *_sweep_columns(variables)), extended_schemas(variables)
    arrays = {each.name: arrow_array(each.cells(episodes), _ARROW_TYPES[each.type]) for each in columns}
    whole, explained = (pa.table([arrays[name] for name in schema.names], schema=schema) for schema in schemas)
    ways, codes = episodes.results.endings
    failed = np.array([success(way) is False for way in ways], np.bool_)[codes] if ways else np.zeros(0, np.bool_)
    return whole, explained if failed.all() else explained.filter(arrow_mask(failed))


def sweep_variables(variables: Mapping[str, Iterable[str | None]]) -> list[str]:
    """Returns the environment variables that are finite numbers in every request that has them, sorted.

    Args:
        variables: The values that each takes in a batch; None where an episode does not set it.
    """
    return [
        name
        for name in sorted(variables)
        if all(_number(value) is not None for value in variables[name] if value is not None)
    ]


def extended_schemas(variables: Sequence[str]) -> tuple[pa.Schema, pa.Schema]:
    """Returns the schemas of results and failures with a column for each of the variables."""
    sweep = _sweep_columns(variables)
    return _schema("results", (*RESULTS_COLUMNS, *sweep)), _schema("failures", (*FAILURES_COLUMNS, *sweep))


def described_field(name: str, kind: pa.DataType, unit: str, meaning: str, *, nullable: bool = False) -> pa.Field:
    """Returns an Arrow field with its unit and meaning as metadata.

    Args:
        name: The column's name.
        kind: Its Arrow type.
        unit: Such as ``m``; empty for none.
        meaning: A sentence.
        nullable: Whether a value may be missing.
    """
    return pa.field(name, kind, nullable=nullable, metadata={"unit": unit, "description": meaning})


def _schema(table: str, columns: Iterable[Column]) -> pa.Schema:
    fields = [
        described_field(each.name, _ARROW_TYPES[each.type], each.unit, each.meaning, nullable=each.nullable)
        for each in columns
    ]
    return pa.schema(fields, metadata={"simyard.table": table, "simyard.schema_version": SCHEMA_VERSION})


def _sweep_columns(variables: Sequence[str]) -> tuple[Column, ...]:
    return tuple(_sweep_column(variable) for variable in variables)


def _sweep_column(variable: str) -> Column:
    """Returns the column of an environment variable that is a number in every episode that has it."""

    def cells(episodes: BatchColumns) -> Cells:
        return episodes.requests.shared(lambda request: _number(request.environment.get(variable)))

    meaning = f"Environment variable {variable} as a number; null where it is not set."
    return Column(f"{SWEEP_PREFIX}{variable}", "double", "", meaning, cells, nullable=True)


def _number(text: str | None) -> float | None:
    """Returns the finite number that the text is, or None."""
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None


RESULTS, FAILURES = extended_schemas(())
"""The schemas of ``results.parquet`` and ``failures.parquet`` without a sweep."""
