"""Makes Arrow tables of episodes: nothing in them depends on the store, the machine or the hour.

The columns are those of ``specs.data.result_columns``, and one more for each environment variable that is a number
everywhere (`sweep_variables`). Arrays are made of cells from the memory that NumPy holds, without an object an entry
and without a copy: ``pyarrow.array`` imports pandas to learn what it was given, and looks at each value.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import cast

import numpy as np
import pyarrow as pa
from jaxtyping import Bool, Int

from specs.data.episode import EpisodeRequest, EpisodeResult, success
from specs.data.episode_columns import Cells, EpisodeColumns, RequestColumns, pair_columns
from specs.data.result_columns import (
    FAILURES_COLUMNS,
    RESULTS_COLUMNS,
    SCHEMA_VERSION,
    BatchColumns,
    Column,
    ColumnType,
)

_DTYPES = {pa.int32(): np.int32, pa.int64(): np.int64, pa.float64(): np.float64}


def arrow_array(cells: Cells, kind: pa.DataType) -> pa.Array:
    """Returns cells as Arrow has them.

    Args:
        cells: A column's.
        kind: Its Arrow type: a number, text or bool, or a list or map of them.

    Raises:
        ValueError: A number is none of that type.
    """
    if cells.lengths is None:
        return _flat(cells, kind)
    if not pa.types.is_map(kind):
        return _lists(cells.ends(), _flat(cells, cast("pa.ListType", kind).value_type), kind)
    found = cast("pa.MapType", kind)
    names = _flat(Cells(codes=cells.codes, labels=cells.labels), found.key_type)
    return _maps(cells.ends(), names, _flat(Cells(numbers=cells.numbers), found.item_type), found)


def arrow_mask(where: Bool[np.ndarray, " rows"]) -> pa.Array:
    """Returns which rows are meant, as Arrow filters by them."""
    return pa.Array.from_buffers(pa.bool_(), len(where), [None, _bits(where)])


def _flat(cells: Cells, kind: pa.DataType) -> pa.Array:
    """Returns one value an entry."""
    if cells.numbers is not None:
        return _numbers(cells.numbers, kind, cells.there)
    labels = _labels(cells.labels, kind)
    return labels if cells.codes is None else labels.take(_numbers(cells.codes, pa.int64()))


def _numbers(numbers: np.ndarray, kind: pa.DataType, there: Bool[np.ndarray, " rows"] | None = None) -> pa.Array:
    missing = None if there is None or there.all() else _bits(there)
    with np.errstate(invalid="ignore"):  # what is no integer is found below
        held = np.ascontiguousarray(numbers, _DTYPES[kind])
    other = held.dtype.kind == "i" and held.dtype != numbers.dtype
    if other and ((held != numbers) & (True if there is None else there)).any():
        raise ValueError(f"a number that is no {kind}")
    return pa.Array.from_buffers(kind, len(held), [missing, _memory(held)])


def _labels(labels: Sequence[object], kind: pa.DataType) -> pa.Array:
    """Returns what entries share; None where they have no value."""
    if pa.types.is_string(kind):
        return _texts(cast("Sequence[str]", labels))
    if pa.types.is_map(kind):
        return _mappings(cast("Sequence[Sequence[tuple[str, str]]]", labels), cast("pa.MapType", kind))
    there = np.array([label is not None for label in labels], np.bool_)
    if pa.types.is_boolean(kind):
        truth = _bits(np.array([label is True for label in labels], np.bool_))
        return pa.Array.from_buffers(kind, len(labels), [_bits(there), truth])
    return _numbers(np.array([0 if label is None else label for label in labels]), kind, there)


def _texts(texts: Sequence[str]) -> pa.Array:
    whole = "".join(texts)
    encoded = whole.encode()
    sizes = map(len, texts) if len(encoded) == len(whole) else (len(text.encode()) for text in texts)
    ends = np.fromiter(itertools.accumulate(sizes, initial=0), np.int32, len(texts) + 1)
    return pa.Array.from_buffers(pa.string(), len(texts), [None, _memory(ends), pa.py_buffer(encoded)])


def _mappings(labels: Sequence[Sequence[tuple[str, str]]], kind: pa.MapType) -> pa.Array:
    pairs = list(itertools.chain.from_iterable(labels))
    names, values = (_texts([pair[part] for pair in pairs]) for part in (0, 1))
    ends = np.fromiter(itertools.accumulate(map(len, labels), initial=0), np.int64, len(labels) + 1)
    return _maps(ends, names, values, kind)


def _maps(ends: Int[np.ndarray, " bounds"], names: pa.Array, values: pa.Array, kind: pa.MapType) -> pa.Array:
    entry = pa.struct([kind.key_field, kind.item_field])
    entries = pa.Array.from_buffers(entry, len(names), [None], children=[names, values])
    return _lists(ends, entries, kind)


def _lists(ends: Int[np.ndarray, " bounds"], entries: pa.Array, kind: pa.DataType) -> pa.Array:
    """Returns a row of entries between each two bounds."""
    return pa.Array.from_buffers(kind, len(ends) - 1, [None, _memory(ends.astype(np.int32))], children=[entries])


def _bits(where: Bool[np.ndarray, " rows"]) -> pa.Buffer:
    return _memory(np.packbits(where, bitorder="little"))


def _memory(array: np.ndarray) -> pa.Buffer:
    """Returns the memory of an array, which it keeps."""
    return pa.py_buffer(array)


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
    endings, codes = episodes.results.endings
    failed = (
        np.array([success(each) is False for each in endings], np.bool_)[codes] if endings else np.zeros(0, np.bool_)
    )
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
