"""Reads from the results of many batches what a trend counts: a few narrow columns, as values and labels.

A thousand files are joined before anything is computed, because each step on its own costs as much for one file as for
a hundred.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, cast

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Bool, Float, Int

from specs.data.result_columns import MEASURES
from tasks.results.tables.episode_tables import extended_schemas

SUCCESS, COLLISION = "success", "collision"
NOT_SET = "(not set)"
_METRICS = "metrics."
_COLUMNS = {SUCCESS: "success", COLLISION: "collisions"}


@dataclass(frozen=True)
class Labels:
    """A column of names.

    Attributes:
        names: Each name once.
        codes: Which name each row has.
    """

    names: tuple[str, ...]
    codes: Int[np.ndarray, " rows"]


@dataclass(frozen=True)
class HistoryRows:
    """The episodes of some batches, as far as a trend counts them.

    Attributes:
        batch: Position of the batch that each row is of.
        value: What is measured: 1 where all is well and 0 where not, or a number; NaN where nothing was measured.
        world: In which world.
        bundle: SHA-256 of its robot application.
        variables: The value of each environment variable that was asked for.
    """

    batch: Int[np.ndarray, " rows"]
    value: Float[np.ndarray, " rows"]
    world: Labels
    bundle: Labels
    variables: Mapping[str, Labels]


class Cell(NamedTuple):
    """Episodes of one batch in one world, of one bundle, with the same values of variables.

    Attributes:
        world: ``<generation>/<name>``.
        bundle: SHA-256 of the robot application.
        variables: Their values, in the order in which they were asked for.
        successes: Episodes in which all was well.
        n: Episodes in which something was measured.
    """

    world: str
    bundle: str
    variables: tuple[str, ...]
    successes: int
    n: int


def measure_column(measure: str) -> str:
    """Returns the column of ``results.parquet`` that a measure is read from; empty if there is none."""
    if measure.startswith(_METRICS):
        return "metrics"
    return _COLUMNS.get(measure) or (measure if measure in MEASURES else "")


def read_rows(body: bytes, measure: str, *, variables: bool) -> pa.Table:
    """Returns the columns of one ``results.parquet`` that `join_rows` needs.

    Args:
        body: The file.
        measure: ``success``, ``collision`` (whose value is 1 where there was none), a column, or ``metrics.<name>``.
        variables: Whether values of environment variables are wanted.

    Raises:
        ValueError: The file is none, or lacks one of the columns, or has it as another type.
    """
    names = ["world", "robot_digest", "success", measure_column(measure)]
    names = [*dict.fromkeys(names), *(["environment"] if variables else [])]
    wanted = _fields(tuple(names))
    try:
        file = pq.ParquetFile(pa.BufferReader(body))
        table = file.read(names, use_threads=False).select(names).replace_schema_metadata(None)
        return table if table.schema.equals(wanted) else table.cast(wanted)
    except (pa.ArrowException, KeyError, OSError) as exc:
        raise ValueError(f"no table of results: {exc}") from exc


@cache
def _fields(names: Sequence[str]) -> pa.Schema:
    known, _ = extended_schemas(())
    return pa.schema([known.field(name) for name in names])


def join_rows(tables: Sequence[pa.Table], measure: str, variables: Sequence[str]) -> HistoryRows:
    """Returns the rows of several batches, one after the other.

    Args:
        tables: What `read_rows` returned; at least one.
        measure: As there.
        variables: Environment variables whose values are wanted.
    """
    rows = pa.concat_tables(tables)
    words = rows.column("environment") if variables else None
    return HistoryRows(
        batch=np.repeat(np.arange(len(tables)), [table.num_rows for table in tables]),
        value=_values(rows, measure),
        world=_labels(rows.column("world")),
        bundle=_labels(rows.column("robot_digest")),
        variables={name: _looked_up(cast("pa.ChunkedArray", words), name) for name in variables},
    )


def count_cells(rows: HistoryRows, good: Bool[np.ndarray, " rows"], batches: int) -> list[tuple[Cell, ...]]:
    """Returns the cells of each batch.

    Args:
        rows: The episodes.
        good: Whether all was well in each.
        batches: How many batches there are.
    """
    labels = [rows.world, rows.bundle, *rows.variables.values()]
    code = rows.batch
    for each in labels:
        code = code * len(each.names) + each.codes
    _, first, cell = np.unique(code, return_index=True, return_inverse=True)
    measured = ~np.isnan(rows.value)
    n = np.bincount(cell, measured, len(first)).astype(np.int64).tolist()
    successes = np.bincount(cell, measured & good, len(first)).astype(np.int64).tolist()
    columns = [[each.names[code] for code in each.codes[first].tolist()] for each in labels]
    found: list[list[Cell]] = [[] for _ in range(batches)]
    names = zip(*columns, strict=True)
    for batch, (world, bundle, *values), passed, count in zip(
        rows.batch[first].tolist(), names, successes, n, strict=True
    ):
        found[batch].append(Cell(world, bundle, tuple(values), passed, count))
    return [tuple(cells) for cells in found]


def _values(rows: pa.Table, measure: str) -> Float[np.ndarray, " rows"]:
    """Returns each row's value; a canceled episode, whose success is null, has none."""
    counted = _whole(rows.column("success").is_valid().cast(pa.int8()))
    found = _whole(rows.column(measure_column(measure)))
    if measure.startswith(_METRICS):
        value = _metric(found, measure.removeprefix(_METRICS))
    else:
        value = _numbers(found.cast(pa.int8()) if measure == SUCCESS else found)
    if measure == COLLISION:
        value = np.where(value > 0, 0.0, 1.0)
    return np.where(_numbers(counted) > 0, value, np.nan)


# Arrow's own to_numpy, fill_null and map_lookup import pandas if it is there, which takes longer than to read a
# thousand files.
def _whole(column: pa.ChunkedArray) -> pa.Array:
    found = column.combine_chunks()
    return pa.concat_arrays(found.chunks) if isinstance(found, pa.ChunkedArray) else found


def _numbers(column: pa.Array) -> Float[np.ndarray, " rows"]:
    """Returns numbers; NaN for null."""
    values = column.cast(pa.float64())
    data = np.frombuffer(values.buffers()[1], np.float64)[values.offset : values.offset + len(values)]
    if not values.null_count:
        return data
    there = values.is_valid().cast(pa.int8())
    return np.where(_numbers(there) > 0, data, np.nan)


def _metric(words: pa.Array, name: str) -> Float[np.ndarray, " rows"]:
    """Returns the number that each row's map has under a name; NaN where there is none."""
    at, rows = _entries(words, name)
    found = np.full(len(words), np.nan)
    found[rows] = _numbers(words.items)[at]
    return found


def _looked_up(words: pa.ChunkedArray, name: str) -> Labels:
    """Returns the text that each row's map has under a name."""
    whole = _whole(words)
    at, rows = _entries(whole, name)
    items = _encoded(whole.items)
    codes = np.full(len(whole), len(items.names) - 1, np.int64)  # the last name says that there is none
    codes[rows] = items.codes[at]
    return Labels(items.names, codes)


def _entries(words: pa.Array, name: str) -> tuple[Int[np.ndarray, " found"], Int[np.ndarray, " found"]]:
    """Returns where in a map's entries a name stands, and in which rows."""
    keys = _encoded(words.keys)
    at = np.flatnonzero(keys.codes == keys.names.index(name)) if name in keys.names else np.zeros(0, np.int64)
    ends = _numbers(words.offsets).astype(np.int64)
    return at, np.searchsorted(ends, at, side="right") - 1


def _labels(column: pa.ChunkedArray) -> Labels:
    return _encoded(_whole(column))


def _encoded(column: pa.Array) -> Labels:
    found = column.cast(pa.string()).dictionary_encode()
    names = cast("list[str]", found.dictionary.to_pylist())
    codes = _numbers(found.indices)
    return Labels((*names, NOT_SET), np.where(np.isnan(codes), len(names), codes).astype(np.int64))
