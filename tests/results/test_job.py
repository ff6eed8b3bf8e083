"""The files of a batch in its bucket."""

import hashlib
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from specs.errors import DocumentError
from tasks.results.job import write_results
from tasks.storage.buckets import open_bucket
from tasks.storage.opening import open_store
from tests.episodes_factory import batch, request

RESULTS = batch(3, 2)
REQUESTS = [request(index) for index in range(5)]


def written(folder: Path, bucket: str = "results", batch_id: str = "simb-1") -> tuple[dict[str, object], Path]:
    opened = open_bucket(open_store(folder.as_uri()), bucket)
    parts = [(REQUESTS[:2], RESULTS[:2]), (REQUESTS[2:], RESULTS[2:])]
    detail, tally = write_results(opened, "/nightly/", batch_id, parts, variables={}, metadata={"engine": "mjx"})
    assert tally.counts().successes == 3
    return dict(detail), Path(opened.url.removeprefix("file://"))


def test_both_tables_lie_under_prefix_and_batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("SIMYARD_BUCKETS", raising=False)
    detail, bucket = written(tmp_path)
    assert detail["results_url"] == f"{bucket.as_uri()}/nightly/simb-1/results.parquet"
    assert pq.read_table(bucket / "nightly/simb-1/results.parquet").num_rows == 5
    assert pq.read_table(bucket / "nightly/simb-1/failures.parquet").num_rows == 2
    body = (bucket / "nightly/simb-1/results.parquet").read_bytes()
    assert detail["sha256s"] == {
        "results.parquet": hashlib.sha256(body).hexdigest(),
        "failures.parquet": hashlib.sha256((bucket / "nightly/simb-1/failures.parquet").read_bytes()).hexdigest(),
    }


def test_another_store_gets_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("SIMYARD_BUCKETS", raising=False)
    first, _ = written(tmp_path / "one")
    second, _ = written(tmp_path / "two", bucket="elsewhere")
    assert first["sha256s"] == second["sha256s"]


def test_a_batch_id_that_would_leave_the_prefix_is_refused(tmp_path: Path):
    with pytest.raises(DocumentError, match="batch"):
        written(tmp_path, batch_id="../evil")
