"""The rows of a batch, read back from its results file, if that is the file that was written."""

import hashlib
from collections.abc import Sequence

import pyarrow as pa
import pyarrow.parquet as pq

from specs.common import OutputLocation
from specs.errors import StageFailed
from tasks.results.job import RESULTS_FILE
from tasks.storage.buckets import open_bucket
from tasks.storage.keys import output_key
from tasks.storage.store import Store


def read_rows(store: Store, location: OutputLocation, batch: str, sha256: str, columns: Sequence[str]) -> pa.Table:
    """Returns columns of a batch's ``results.parquet``, a row an episode in the order of their indices.

    Args:
        store: The store that the output location's bucket belongs to.
        location: The batch's output location.
        batch: The batch's id.
        sha256: Of the file as it was written.
        columns: Names of columns.

    Raises:
        ObjectNotFound: There is no such file any more.
        StageFailed: It is not what was written.
    """
    bucket = open_bucket(store, location.s3Bucket or "")
    key = output_key(location.s3Prefix, f"{batch}/{RESULTS_FILE}")
    body = bucket.get(key).body
    found = hashlib.sha256(body).hexdigest()
    if found != sha256:
        reason = f"{bucket.url}/{key} is not what the batch wrote: its SHA-256 is {found}, not {sha256}"
        raise StageFailed("MismatchedEtag", reason)
    return pq.read_table(pa.BufferReader(body), columns=list(columns))
