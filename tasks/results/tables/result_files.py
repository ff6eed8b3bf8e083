"""Writes the result files of a batch into the bucket that its document names, and reads them."""

import hashlib
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import cast

import pyarrow as pa
import pyarrow.parquet as pq
from pydantic import JsonValue

from specs.data.episode_columns import pair_columns
from specs.errors import ObjectNotFound, ResourceNotFound, StageFailed
from specs.field_types import OutputLocation
from tasks.results.statistics.batch_summary import EpisodeTally
from tasks.results.tables.episode_tables import Requests, Results, both_tables, extended_schemas, sweep_variables
from tasks.results.tables.parquet import ParquetFile, parquet_thread
from tasks.results.tables.recordings import RECORDINGS_FOLDER
from tasks.storage.base.keys import checked_name, output_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket

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
    leaves = [leaf for field in schema if field.name not in _NAMES for leaf in _leaves(field)]
    # Texts and counts are repeated, but for what tells one row from another.
    repeated = [name for name, kind in leaves if not pa.types.is_floating(kind)]
    return ParquetFile(path, schema, metadata, dictionary=repeated, level=_LEVEL)


def _leaves(field: pa.Field) -> list[tuple[str, pa.DataType]]:
    """Returns what Parquet calls the columns of a field, and their types."""
    if pa.types.is_map(field.type):
        named = cast("pa.MapType", field.type)
        return [(f"{field.name}.key_value.key", named.key_type), (f"{field.name}.key_value.value", named.item_type)]
    if pa.types.is_list(field.type):
        return [(f"{field.name}.list.element", cast("pa.ListType", field.type).value_type)]
    return [(field.name, field.type)]


WORLDS = "worlds_driven"
"""Where a batch's record says in how many worlds its episodes came to an end."""
ROOMS = "rooms"
"""Where a batch's record says which rooms robots were in, as a `RoomCoverage`."""


def write_batch_tables(
    store: Store,
    batch: str,
    parts: Iterable[EpisodePart],
    *,
    variables: Variables,
    location: OutputLocation,
    metadata: Mapping[str, str],
) -> tuple[dict[str, JsonValue], EpisodeTally]:
    """Writes a batch's tables; returns where they lie and what they add up to, for its record, and the tally.

    Args:
        store: The store that the output location's bucket belongs to.
        batch: The batch's id.
        parts: Its episodes in the order of their indices, some at a time.
        variables: The values that each environment variable takes in the batch.
        location: Where the tables go.
        metadata: For the files' footers and the record; what the rows say of engines and devices is added.
    """
    bucket = open_bucket(store, location.s3Bucket or "")
    written, tally = write_results(bucket, location.s3Prefix, batch, parts, variables=variables, metadata=metadata)
    counts = tally.counts()
    why_not: list[JsonValue] = [
        {"reason": name, "episodes": count, "sample": sample} for name, count, sample in tally.why_not()
    ]
    detail: dict[str, JsonValue] = {
        **written,
        "metadata": _metadata(metadata, tally),
        "episodes": counts.episodes + counts.canceled,
        "passed": counts.successes,
        "simulated_s": round(tally.simulated_s, 3),
        "counts": counts.model_dump(),
        WORLDS: tally.worlds(),
        "failed_inside": sum(count for name, count, _ in tally.why_not() if name == "InternalServiceError"),
        "why_not": why_not,
    }
    rooms = tally.rooms()
    if rooms:
        detail[ROOMS] = rooms.model_dump(mode="json")
    return detail, tally


def recounted_facts(
    batch: str, parts: Iterable[EpisodePart], *, variables: Variables, metadata: Mapping[str, str]
) -> dict[str, JsonValue]:
    """Returns what a batch's record has to say of its tables and counts; nothing is written.

    Args:
        batch: The batch's id.
        parts: Its episodes in the order of their indices, some at a time.
        variables: The values that each environment variable takes in the batch.
        metadata: For the files' footers; what the rows say of engines and devices is added, over what it says of them.
    """
    digests, tally = recounted_results(batch, parts, variables=variables, metadata=metadata)
    return {
        "sha256s": {**digests},
        "metadata": _metadata(metadata, tally),
        "counts": tally.counts().model_dump(),
    }


def _metadata(metadata: Mapping[str, str], tally: EpisodeTally) -> dict[str, JsonValue]:
    return {**metadata, **tally.ran_on()}


def stored_rows(
    store: Store,
    location: OutputLocation,
    batch_id: str,
    name: str,
    *,
    sha256: str = "",
    columns: Sequence[str] | None = None,
    index: int | None = None,
) -> pa.Table:
    """Returns the rows of one of a batch's tables in the order of their indices, all or those of one episode.

    Args:
        store: The store that the output location's bucket belongs to.
        location: The batch's output location.
        batch_id: The batch.
        name: ``results.parquet`` or ``failures.parquet``.
        sha256: Of the file as it was written; empty to read whatever lies there, as a replay does, which finds out.
        columns: Names of columns, of which an older batch may lack some; None for all.
        index: Which episode; None for all.

    Raises:
        ResourceNotFound: The file is gone.
        StageFailed: It is not what was written.
    """
    body = _read(store, location, f"{batch_id}/{name}", sha256)
    there = [column for column in columns if column in pq.read_schema(body).names] if columns else None
    return pq.read_table(body, columns=there, filters=_only(index))


def recorded_samples(store: Store, location: OutputLocation, batch_id: str, name: str, index: int) -> pa.Table:
    """Returns an episode's recording, by the name of its file.

    Args:
        store: The store that the output location's bucket belongs to.
        location: The batch's output location.
        batch_id: The batch.
        name: The file's name below the batch's recordings.
        index: The episode.

    Raises:
        ResourceNotFound: The file is gone.
    """
    body = _read(store, location, f"{RECORDINGS_FOLDER}/{batch_id}/{name}")
    return pq.read_table(body, filters=_only(index))


def changed_tables(
    store: Store, location: OutputLocation, batch_id: str, sha256s: Mapping[str, str], names: Sequence[str]
) -> list[str]:
    """Returns a sentence for each of some of a batch's files that is not what the batch wrote.

    Args:
        store: The store that the output location's bucket belongs to.
        location: The batch's output location.
        batch_id: The batch.
        sha256s: Of its files as they were written, by name; a file without one may be anything.
        names: Of the files.

    Raises:
        ResourceNotFound: A file is gone.
    """
    told: list[str] = []
    for name in names:
        try:
            _read(store, location, f"{batch_id}/{name}", sha256s.get(name, ""))
        except StageFailed as changed:
            told.append(changed.reason)
    return told


def require_as_written(found: str, sha256: str, url: str) -> None:
    """Lets a file of a batch pass if it is the one that was written.

    Raises:
        StageFailed: Its SHA-256 is another one.
    """
    if found != sha256:
        reason = f"{url} is not what the batch wrote: its SHA-256 is {found}, not {sha256}"
        raise StageFailed("MismatchedEtag", reason)


def _read(store: Store, location: OutputLocation, path: str, sha256: str = "") -> pa.BufferReader:
    bucket, key = open_bucket(store, location.s3Bucket or ""), output_key(location.s3Prefix, path)
    url = f"{bucket.url}/{key}"
    try:
        body = bucket.get(key).body
    except ObjectNotFound as exc:
        raise ResourceNotFound.of(
            "outputLocation", url, "a file that its batch has left there", source="simyard"
        ) from exc
    if sha256:
        require_as_written(hashlib.sha256(body).hexdigest(), sha256, url)
    return pa.BufferReader(body)


def _only(index: int | None) -> list[tuple[str, str, int]] | None:
    return None if index is None else [("index", "=", index)]
