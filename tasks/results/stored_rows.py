"""Rows of a batch's files, read back from where its document put them."""

import pyarrow as pa
import pyarrow.parquet as pq

from specs.base import Fault
from specs.common import OutputLocation
from specs.errors import ObjectNotFound, ResourceNotFound
from tasks.results.recordings import RECORDINGS_FOLDER
from tasks.storage.buckets import open_bucket
from tasks.storage.keys import output_key
from tasks.storage.store import Store


def stored_rows(store: Store, location: OutputLocation, batch_id: str, name: str, index: int | None = None) -> pa.Table:
    """Returns the rows of one of a batch's tables, all or those of one episode.

    Args:
        store: The store that the output location's bucket belongs to.
        location: The batch's output location.
        batch_id: The batch.
        name: ``results.parquet`` or ``failures.parquet``.
        index: Which episode; None for all.

    Raises:
        ResourceNotFound: The file is gone.
    """
    return _read(store, location, f"{batch_id}/{name}", index)


def recorded_samples(store: Store, location: OutputLocation, batch_id: str, name: str, index: int) -> pa.Table:
    """Returns an episode's recording, by the name of its file.

    Raises:
        ResourceNotFound: The file is gone.
    """
    return _read(store, location, f"{RECORDINGS_FOLDER}/{batch_id}/{name}", index)


def _read(store: Store, location: OutputLocation, path: str, index: int | None) -> pa.Table:
    bucket, key = open_bucket(store, location.s3Bucket or ""), output_key(location.s3Prefix, path)
    try:
        body = bucket.get(key).body
    except ObjectNotFound as exc:
        fault = Fault(
            path="outputLocation", value=f"{bucket.url}/{key}", allowed="a file that its batch has left there"
        )
        raise ResourceNotFound([fault], source="simyard") from exc
    wanted = None if index is None else [("index", "=", index)]
    return pq.read_table(pa.BufferReader(body), filters=wanted)
