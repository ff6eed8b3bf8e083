"""Recordings: what was sampled is read back, the same samples are the same bytes, and nothing is left over."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from specs.field_types import OutputLocation
from tasks.results.tables import parquet
from tasks.results.tables.recordings import PICTURES, RECORDING, recordings_url, write_recordings
from tasks.storage.store_url import open_store
from tests.docs.reference.test_schema_document import described
from tests.docs.reference.test_schema_document import documented as documented_in
from tests.factories.recordings import samples
from tests.repository import ROOT

WHERE = OutputLocation(s3Bucket="results", s3Prefix="/nightly/")
DOCUMENT = (ROOT / "docs/reference/recordings-schema.md").read_text()


@pytest.fixture
def store_url(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.delenv("SIMYARD_BUCKETS", raising=False)
    return open_store((tmp_path / "store").as_uri()).url


def written(store_url: str, *parts: dict[str, np.ndarray], pictures: bool = False) -> Path:
    name = write_recordings(store_url, WHERE, "simb-1", 3, parts, pictures=pictures)
    return Path(recordings_url(store_url, WHERE, "simb-1").removeprefix("file://")) / name


def test_a_row_is_a_sample_beside_the_results(store_url: str):
    file = written(store_url, samples(5, 7))
    assert file.as_posix().endswith("/buckets/results/nightly/recordings/simb-1/000003.parquet")
    rows = pq.read_table(file).to_pylist()
    assert [row["index"] for row in rows] == [5] * 4 + [7] * 4
    assert rows[6] == {
        "index": 7,
        "t_s": 0.2,
        "x_m": 6.0,
        "y_m": -6.0,
        "yaw_rad": pytest.approx(0.6),
        "vx_m_s": 6.0,
        "vy_m_s": 6.5,
        "yaw_rad_s": -6.0,
        "goal_index": 0,
        "control": [6.0, 6.25],
        "ranges_m": [6.0, 6.0, 6.0],
        "impulse_ns": 0.0,
    }
    assert (rows[7]["control"], rows[7]["ranges_m"], rows[7]["impulse_ns"]) == ([], [], 1.0)


def test_a_robot_without_a_lidar_has_empty_scans(store_url: str):
    blind = {**samples(0), "ranges_m": np.zeros((4, 0), np.float32)}
    assert pq.read_table(written(store_url, blind)).column("ranges_m").to_pylist() == [[]] * 4


def test_pictures_stand_at_the_samples_at_which_they_were_taken_and_only_where_they_are_kept(store_url: str):
    kept = {"depth_png": np.array([b"\x89PNG", None, None, None], object), "color_jpeg": np.full(4, None, object)}
    table = pq.read_table(written(store_url, {**samples(5), **kept}, pictures=True))
    assert table.column("depth_png").to_pylist() == [b"\x89PNG", None, None, None]
    assert table.column("color_jpeg").null_count == 4
    assert table.schema.names == [*RECORDING.names, *PICTURES.names]
    assert pq.read_schema(written(store_url, samples(5))).names == RECORDING.names


def test_however_the_samples_come_the_bytes_are_the_same(store_url: str, tmp_path: Path):
    whole = written(store_url, samples(5, 7)).read_bytes()
    first, second = ({name: values[part] for name, values in samples(5, 7).items()} for part in (np.s_[:3], np.s_[3:]))
    elsewhere = open_store((tmp_path / "other").as_uri()).url
    assert written(elsewhere, first, second).read_bytes() == whole


def test_what_a_broken_attempt_left_is_overwritten_or_removed(store_url: str):
    file = written(store_url, samples(5, 7))
    assert pq.read_table(written(store_url, samples(5))).num_rows == 4
    assert write_recordings(store_url, WHERE, "simb-1", 3, []) == ""
    assert not file.exists()
    assert write_recordings(store_url, WHERE, "simb-1", 3, []) == ""


def test_a_reader_of_one_episode_reads_few_row_groups(store_url: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(parquet, "ROW_GROUP_ROWS", 8)
    file = pq.ParquetFile(written(store_url, samples(*range(10))))
    column = RECORDING.names.index("index")
    spans = [file.metadata.row_group(group).column(column).statistics for group in range(file.metadata.num_row_groups)]
    assert [(span.min, span.max) for span in spans] == [(first, first + 1) for first in range(0, 10, 2)]


def test_every_column_is_documented_with_its_unit():
    assert documented_in("recordings/*.parquet", DOCUMENT) == [described(field) for field in (*RECORDING, *PICTURES)]
    for field in RECORDING:
        unit = (field.metadata or {})[b"unit"].decode().lower().replace("/", "_")
        assert not unit or field.name.endswith(f"_{unit}")
    assert "version 1 of the schema" in DOCUMENT
