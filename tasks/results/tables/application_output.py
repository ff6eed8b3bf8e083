"""Writes what a batch's applications printed, a file a chunk, beside its recordings."""

from specs.field_types import OutputLocation
from tasks.storage.base.key_rules import checked_name
from tasks.storage.base.keys import output_key
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import open_store

OUTPUT_FOLDER = "output"


def write_output(store_url: str, location: OutputLocation, batch_id: str, number: int, text: str) -> None:
    """Writes what applications printed while a chunk was simulated, over what an earlier attempt at it printed.

    Args:
        store_url: The store that the output location's bucket belongs to.
        location: The batch's output location.
        batch_id: The batch.
        number: The chunk's number.
        text: What was printed.
    """
    bucket = open_bucket(open_store(store_url), location.s3Bucket or "")
    key = output_key(location.s3Prefix, f"{OUTPUT_FOLDER}/{checked_name(batch_id, 'batch')}/{number:06d}.txt")
    bucket.put(key, text.encode())
