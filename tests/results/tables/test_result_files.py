"""The files of a batch in its bucket."""

import hashlib
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from specs.errors import DocumentError, ObjectNotFound
from tasks.results.statistics.batch_summary import EpisodeTally
from tasks.results.tables.result_files import EpisodePart, write_results
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import open_store
from tests.factories.episodes import batch, crashed, request

RESULTS = batch(3, 2)
REQUESTS = [request(index) for index in range(5)]


def written(folder: Path, bucket: str = "results", batch_id: str = "simb-1") -> tuple[dict[str, object], Path]:
    opened = open_bucket(open_store(folder.as_uri()), bucket)
    parts = [(REQUESTS[:2], RESULTS[:2]), (REQUESTS[2:], RESULTS[2:])]
    detail, tally = write_results(opened, "/nightly/", batch_id, parts, variables={}, metadata={"mujoco": "3.17.0"})
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


def test_footers_name_what_the_rows_ran_on(tmp_path: Path):
    ran = {"engine": "planar", "device": "cpu"}
    results = [*(row.model_copy(update=ran) for row in RESULTS[:4]), crashed(4)]
    bucket = open_bucket(open_store(tmp_path.as_uri()), "results")
    detail, tally = write_results(bucket, None, "b", [(REQUESTS, results)], variables={}, metadata={"jax": "1"})
    assert tally.ran_on() == ran
    assert detail.keys() == {"results_url", "failures_url", "sha256s"}
    for name in ("results", "failures"):
        footer = pq.read_metadata(Path(str(detail[f"{name}_url"]).removeprefix("file://"))).metadata
        assert [footer[key] for key in (b"engine", b"device", b"jax")] == [b"planar", b"cpu", b"1"]


def test_episodes_that_never_ran_ran_on_none():
    assert EpisodeTally().ran_on() == {"engine": "none", "device": "none"}


def test_another_store_gets_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("SIMYARD_BUCKETS", raising=False)
    first, _ = written(tmp_path / "one")
    second, _ = written(tmp_path / "two", bucket="elsewhere")
    assert first["sha256s"] == second["sha256s"]


def test_a_batch_id_that_would_leave_the_prefix_is_refused(tmp_path: Path):
    with pytest.raises(DocumentError, match="batch"):
        written(tmp_path, batch_id="../evil")


@pytest.mark.parametrize("table", ["results", "failures"])
def test_texts_and_counts_have_a_dictionary_and_neither_measures_nor_names_of_rows_do(
    table: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.delenv("SIMYARD_BUCKETS", raising=False)
    _, bucket = written(tmp_path)
    group = pq.read_metadata(bucket / f"nightly/simb-1/{table}.parquet").row_group(0)
    columns = [group.column(number) for number in range(group.num_columns)]
    plain = {each.path_in_schema for each in columns if not each.has_dictionary_page}
    doubles = {each.path_in_schema for each in columns if each.physical_type == "DOUBLE"}
    assert doubles >= {"path_length_m", "goal_times_s.list.element", "metrics.key_value.value"}
    assert plain == doubles | {"job", "index", "success"}


def test_a_chunk_that_cannot_be_read_ends_the_write_and_leaves_no_file(tmp_path: Path):
    bucket = open_bucket(open_store(tmp_path.as_uri()), "results")

    def parts() -> Iterator[EpisodePart]:
        yield REQUESTS[:2], RESULTS[:2]
        raise ObjectNotFound("chunk 1")

    with pytest.raises(ObjectNotFound, match="chunk 1"):
        write_results(bucket, None, "b", parts(), variables={}, metadata={})
    assert not list(bucket.keys(""))
