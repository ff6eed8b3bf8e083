"""Reads from the results of many batches what a trend counts: a few narrow columns, as values and labels.

A thousand files are joined before anything is computed, because each step on its own costs as much for one file as for
a hundred.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from jaxtyping import Bool, Float, Int

from specs.base import Spec
from specs.data.result_columns import MEASURES

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


class Cell(Spec):
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
    """
    names = ["world", "robot_digest", "success", measure_column(measure)]
    names = [*dict.fromkeys(names), *(["environment"] if variables else [])]
    table = pq.ParquetFile(pa.BufferReader(body)).read(names, use_threads=False)
    return table.select(names).replace_schema_metadata(None)


def join_rows(tables: Sequence[pa.Table], measure: str, variables: Sequence[str]) -> HistoryRows:
    """Returns the rows of several batches, one after the other.

    Args:
        tables: What `read_rows` returned; at least one.
        measure: As there.
        variables: Environment variables whose values are wanted.
    """
    # Descriptions of columns differ from version to version; what is in them does not.
    rows = pa.concat_tables([_plain(table) for table in tables])
    words = rows.column("environment") if variables else None
    return HistoryRows(
        batch=np.repeat(np.arange(len(tables)), [table.num_rows for table in tables]),
        value=_values(rows, measure),
        world=_labels(rows.column("world")),
        bundle=_labels(rows.column("robot_digest")),
        variables={name: _labels(_looked_up(cast("pa.ChunkedArray", words), name)) for name in variables},
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
    n = np.bincount(cell, measured, len(first)).astype(np.int64)
    successes = np.bincount(cell, measured & good, len(first)).astype(np.int64)
    found: list[list[Cell]] = [[] for _ in range(batches)]
    for at, row in enumerate(first):
        world, bundle, *values = (each.names[each.codes[row]] for each in labels)
        found[rows.batch[row]].append(
            Cell(world=world, bundle=bundle, variables=tuple(values), successes=int(successes[at]), n=int(n[at]))
        )
    return [tuple(cells) for cells in found]


def _plain(table: pa.Table) -> pa.Table:
    return pa.table(table.columns, names=table.column_names)


def _values(rows: pa.Table, measure: str) -> Float[np.ndarray, " rows"]:
    """Returns each row's value; a canceled episode, whose success is null, has none."""
    counted = rows.column("success").is_valid().to_numpy()
    found = rows.column(measure_column(measure))
    if measure.startswith(_METRICS):
        found = _looked_up(found, measure.removeprefix(_METRICS))
    if measure == SUCCESS:
        found = found.cast(pa.int8())
    value = found.cast(pa.float64()).fill_null(np.nan).to_numpy()
    if measure == COLLISION:
        value = np.where(value > 0, 0.0, 1.0)
    return np.where(counted, value, np.nan)


def _looked_up(words: pa.ChunkedArray, name: str) -> pa.ChunkedArray:
    return pc.call_function("map_lookup", [words], pc.MapLookupOptions(name, "first"))  # pyright: ignore[reportAttributeAccessIssue] - stubs


def _labels(column: pa.ChunkedArray) -> Labels:
    encoded = column.cast(pa.string()).fill_null(NOT_SET).combine_chunks().dictionary_encode()
    encoded = encoded.chunk(0) if isinstance(encoded, pa.ChunkedArray) else encoded
    names = cast("list[str]", encoded.dictionary.to_pylist())
    return Labels(tuple(names), encoded.indices.to_numpy(zero_copy_only=False).astype(np.int64))
