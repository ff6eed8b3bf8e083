"""The result files of a batch, in the bucket that its document names."""

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import JsonValue

from specs.episode import EpisodeRequest, EpisodeResult
from tasks.results.parquet import write_parquet
from tasks.results.tables import failures_table, results_table
from tasks.storage.keys import checked_name, output_key
from tasks.storage.store import Store

RESULTS_FILE = "results.parquet"
FAILURES_FILE = "failures.parquet"


def write_results(
    bucket: Store,
    prefix: str | None,
    batch_id: str,
    requests: Sequence[EpisodeRequest],
    results: Sequence[EpisodeResult],
    *,
    metadata: Mapping[str, str],
) -> dict[str, JsonValue]:
    """Writes both tables and returns where they lie: ``results_url``, ``failures_url``, ``sha256s`` by file name.

    Each file appears whole under ``<prefix>/<batch>/``; the same batch again writes the same bytes over them.

    Args:
        bucket: The output location's bucket.
        prefix: Its prefix, with or without slashes, or None.
        batch_id: The batch.
        requests: All its episodes.
        results: One for each request, in any order.
        metadata: For the files' footers: engine, versions, digests; no times, no places.

    Raises:
        ValueError: The requests and results do not pair up.
        StoreError: The bucket could not be written.
    """
    tables = {
        RESULTS_FILE: results_table(batch_id, requests, results),
        FAILURES_FILE: failures_table(batch_id, requests, results),
    }
    urls: dict[str, str] = {}
    sha256s: dict[str, JsonValue] = {}
    with tempfile.TemporaryDirectory(prefix="simyard-results-") as folder:
        for name, table in tables.items():
            key = output_key(prefix, f"{checked_name(batch_id, 'batch')}/{name}")
            sha256s[name] = write_parquet(table, Path(folder) / name, metadata)
            bucket.upload(key, Path(folder) / name)
            urls[name] = f"{bucket.url}/{key}"
    return {"results_url": urls[RESULTS_FILE], "failures_url": urls[FAILURES_FILE], "sha256s": sha256s}
