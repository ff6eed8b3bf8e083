"""Reads rows of a batch's files from where its document put them."""

import hashlib
from collections.abc import Mapping, Sequence

import pyarrow as pa
import pyarrow.parquet as pq

from specs.base import Fault
from specs.errors import ObjectNotFound, ResourceNotFound, StageFailed
from specs.field_types import OutputLocation
from tasks.results.tables.recordings import RECORDINGS_FOLDER
from tasks.storage.base.keys import output_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket


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
        columns: Names of columns; None for all. Those that the file does not have, being of an older version, are left
            out.
        index: Which episode; None for all.

    Raises:
        ResourceNotFound: The file is gone.
        StageFailed: It is not what was written.
    """
    body = _read(store, location, f"{batch_id}/{name}", sha256)
    there = frozenset(pq.read_schema(body).names)
    wanted = [name for name in columns if name in there] if columns else None
    return pq.read_table(body, columns=wanted, filters=_only(index))


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
        fault = Fault(path="outputLocation", value=url, allowed="a file that its batch has left there")
        raise ResourceNotFound([fault], source="simyard") from exc
    if sha256:
        require_as_written(hashlib.sha256(body).hexdigest(), sha256, url)
    return pa.BufferReader(body)


def _only(index: int | None) -> list[tuple[str, str, int]] | None:
    return None if index is None else [("index", "=", index)]
