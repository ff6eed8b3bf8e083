"""What a report shows of what robots saw last: a few small pictures of their recordings, and nothing strange."""

import base64
import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from specs.field_types import OutputLocation
from tasks.results.playback.robot_view import PALETTE
from tasks.results.report.last_pictures import SeenPicture, last_seen
from tasks.results.report.report_columns import FailedEpisode
from tasks.results.tables.recordings import recording_table
from tasks.ros.message.camera_messages import depth_png, jpeg_bytes
from tasks.storage.base.store import Store
from tests.factories.recordings import samples

LOCATION = OutputLocation(s3Bucket="results", s3Prefix="seen")
Seen = tuple[SeenPicture, ...]


def _failure(index: int, recording: str = "000000.parquet") -> FailedEpisode:
    end, none = (0.0, 0.0), dict[str, str]()
    return FailedEpisode(0, index, "w/1", 1, "stuck", "", 9.0, 0, 1, end, none, None, None, recording)


@pytest.fixture
def seen_of(file_store: Store, tmp_path: Path) -> Callable[[list[bytes | None], list[bytes | None]], Seen]:
    """Returns a function from an episode's pictures, a row each, to what a report shows of it."""

    def shown(depths: list[bytes | None], colors: list[bytes | None]) -> Seen:
        rows = samples(3, rows=len(depths))
        kept = {"depth_png": np.array(depths, object), "color_jpeg": np.array(colors, object)}
        pq.write_table(recording_table({**rows, **kept}), tmp_path / "written.parquet")
        file_store.upload("seen/recordings/simb-1/000000.parquet", tmp_path / "written.parquet")
        return last_seen(file_store, LOCATION, "simb-1", tmp_path)(_failure(3))

    return shown


def _pixels(seen: SeenPicture) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(seen.url.partition("base64,")[2]))).convert("RGB"))


def test_the_last_three_of_each_camera_are_shown_the_oldest_first(seen_of: Callable[..., Seen]):
    depths = [depth_png(np.full((4, 6), metres), 9.0) for metres in (1.0, 2.0, 3.0, 4.0)]
    grey = jpeg_bytes(np.full((4, 6, 3), 90, np.uint8))
    found = seen_of([*depths, None], [None, None, None, grey, None])
    assert [each.when for each in found] == ["0.10 s", "0.20 s", "0.30 s", "0.30 s"]
    light = [_pixels(each).astype(int).sum() for each in found[:3]]
    assert light[0] > light[1] > light[2]
    assert found[2].label == "depth, light 0 m to dark 4.0 m"
    np.testing.assert_allclose(_pixels(found[3]), 90, atol=2)


def test_nothing_that_was_seen_has_its_own_colour(seen_of: Callable[..., Seen]):
    (found,) = seen_of([depth_png(np.array([[1.0, 9.0]]), 9.0)], [None])
    assert _pixels(found)[0].tolist() == [PALETTE[-2].tolist(), PALETTE[-1].tolist()]


def test_of_many_failures_the_first_are_shown(seen_of: Callable[..., Seen], file_store: Store, tmp_path: Path):
    assert len(seen_of([depth_png(np.ones((2, 2)), 9.0)], [None])) == 1
    seen = last_seen(file_store, LOCATION, "simb-1", tmp_path)
    assert [len(seen(_failure(3))) for _ in range(38)] == [1] * 36 + [0] * 2


def test_large_pictures_are_shown_small(seen_of: Callable[..., Seen]):
    (found,) = seen_of([None], [jpeg_bytes(np.zeros((480, 640, 3), np.uint8))])
    assert _pixels(found).shape == (120, 160, 3)


@pytest.mark.parametrize("strange", [b"", b"GIF89a", jpeg_bytes(np.zeros((481, 640, 3), np.uint8))])
def test_what_is_no_picture_or_too_large_is_left_out(
    seen_of: Callable[..., Seen], strange: bytes, caplog: pytest.LogCaptureFixture
):
    assert seen_of([None], [strange]) == ()
    assert "job simb-1/3: no pictures in the report" in caplog.text


def test_a_recording_that_is_gone_or_that_keeps_none_shows_none(file_store: Store, tmp_path: Path):
    assert last_seen(file_store, LOCATION, "simb-1", tmp_path)(_failure(3)) == ()
    pq.write_table(recording_table(samples(3, rows=2)), tmp_path / "000001.parquet")
    assert last_seen(file_store, LOCATION, "simb-1", tmp_path)(_failure(3, "000001.parquet")) == ()


def test_a_recordings_name_leads_nowhere_else(file_store: Store, tmp_path: Path, caplog: pytest.LogCaptureFixture):
    assert last_seen(file_store, LOCATION, "simb-1", tmp_path)(_failure(3, "../secret.parquet")) == ()
    assert "no pictures in the report" in caplog.text
