"""Writes the result files of a batch into the bucket that its document names."""

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import cast

import pyarrow as pa
from pydantic import JsonValue

from specs.data.episode_columns import pair_columns
from tasks.results.statistics.summary import EpisodeTally
from tasks.results.tables.parquet import ParquetFile
from tasks.results.tables.parquet_thread import parquet_thread
from tasks.results.tables.tables import Requests, Results, both_tables, extended_schemas, sweep_variables
from tasks.storage.base.key_rules import checked_name
from tasks.storage.base.keys import output_key
from tasks.storage.base.store import Store

RESULTS_FILE = "results.parquet"
FAILURES_FILE = "failures.parquet"
# What tells one row from another; no two rows share it.
_NAMES = frozenset({"job", "index"})
# Files are smaller than with dictionaries and level 3, and take two thirds of the time (docs/decisions/0040).
_LEVEL = 1
EpisodePart = tuple[Requests, Results]
Variables = Mapping[str, Sequence[str | None]]


def write_results(
    bucket: Store,
    prefix: str | None,
    batch_id: str,
    parts: Iterable[EpisodePart],
    *,
    variables: Variables,
    metadata: Mapping[str, str],
) -> tuple[dict[str, JsonValue], EpisodeTally]:
    """Writes both tables; returns where they lie, and what the episodes came to.

    Where they lie is ``results_url``, ``failures_url``, and ``sha256s`` by file name. Each file appears whole under
    ``<prefix>/<batch>/``; the same batch again writes the same bytes over them. No more than three
    parts and a row group is held in memory.

    Args:
        bucket: The output location's bucket.
        prefix: Its prefix, with or without slashes, or None.
        batch_id: The batch.
        parts: All its episodes in the order of their indices, some at a time: requests, and a result for each.
        variables: The values that each environment variable takes in the batch; None where an episode lacks it.
        metadata: For the files' footers: versions, lanes; no times, no places. What the rows say of engine and device
            is added.

    Raises:
        ValueError: The requests and results do not pair up.
        StoreError: The bucket could not be written.
    """
    urls: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="simyard-results-") as folder:
        digests, tally = _write(Path(folder), batch_id, parts, variables, metadata)
        for name in digests:
            key = output_key(prefix, f"{checked_name(batch_id, 'batch')}/{name}")
            bucket.upload(key, Path(folder) / name)
            urls[name] = f"{bucket.url}/{key}"
    where: dict[str, JsonValue] = {"results_url": urls[RESULTS_FILE], "failures_url": urls[FAILURES_FILE]}
    return {**where, "sha256s": {**digests}}, tally


def recounted_results(
    batch_id: str, parts: Iterable[EpisodePart], *, variables: Variables, metadata: Mapping[str, str]
) -> tuple[dict[str, str], EpisodeTally]:
    """Returns the SHA-256 that each table has when it is written from these episodes, and what they came to.

    Nothing is kept.

    Args:
        batch_id: The batch.
        parts: All its episodes, as ``write_results`` takes them.
        variables: The values that each environment variable takes in the batch.
        metadata: For the files' footers.
    """
    with tempfile.TemporaryDirectory(prefix="simyard-recount-") as folder:
        return _write(Path(folder), batch_id, parts, variables, metadata)


def _write(
    folder: Path, batch_id: str, parts: Iterable[EpisodePart], variables: Variables, metadata: Mapping[str, str]
) -> tuple[dict[str, str], EpisodeTally]:
    """Returns the SHA-256 of each file by name, and the tally."""
    swept = sweep_variables(variables)
    tally = EpisodeTally([name for name, values in variables.items() if len(values) > 1])
    schemas = extended_schemas(swept)
    with (
        _file(folder / RESULTS_FILE, schemas[0], metadata) as results,
        _file(folder / FAILURES_FILE, schemas[1], metadata) as failures,
    ):
        with parquet_thread(results) as add_results, parquet_thread(failures) as add_failures:
            for requests, answers in parts:
                asked, answered = pair_columns(requests, answers)
                tally.add(asked, answered)
                whole, explained = both_tables(batch_id, asked, answered, swept)
                add_results(whole)
                add_failures(explained)
        for table in (results, failures):
            table.note(tally.ran_on())
        return {RESULTS_FILE: results.sha256(), FAILURES_FILE: failures.sha256()}, tally


def _file(path: Path, schema: pa.Schema, metadata: Mapping[str, str]) -> ParquetFile:
    return ParquetFile(path, schema, metadata, dictionary=_repeated(schema), level=_LEVEL)


def _repeated(schema: pa.Schema) -> list[str]:
    """Returns the columns in which values are repeated: texts and counts, but not what tells one row from another."""
    leaves = [leaf for field in schema if field.name not in _NAMES for leaf in _leaves(field)]
    return [name for name, kind in leaves if not pa.types.is_floating(kind)]


def _leaves(field: pa.Field) -> list[tuple[str, pa.DataType]]:
    """Returns what Parquet calls the columns of a field, and their types."""
    if pa.types.is_map(field.type):
        named = cast("pa.MapType", field.type)
        return [(f"{field.name}.key_value.key", named.key_type), (f"{field.name}.key_value.value", named.item_type)]
    if pa.types.is_list(field.type):
        return [(f"{field.name}.list.element", cast("pa.ListType", field.type).value_type)]
    return [(field.name, field.type)]
