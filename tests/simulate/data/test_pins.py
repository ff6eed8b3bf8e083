"""Data sources as a plan has them: pinned by content, or with why they cannot be had."""

from pathlib import Path

import pytest

from specs.errors import StoreUnreachable
from specs.robomaker.simulation import DataSourceConfig
from tasks.simulate.data.data_sources import PinnedFile, PinnedSource, within_limits
from tasks.simulate.data.mounts import pin_source
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.store_url import open_store
from tests.factories.data_buckets import cache, source


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        (source("maps/lost.yaml"), ("InvalidS3Resource", "there is no maps-bucket/maps/lost.yaml")),
        (source("maps"), ("InvalidS3Resource", "there is no maps-bucket/maps")),
        (source("../", type="Prefix"), ("InvalidInput", "'..'")),
        (source("/etc/passwd"), ("InvalidInput", "'/etc/passwd'")),
        (source(".hidden"), ("InvalidInput", "'.hidden'")),
        (source("lost/", type="Prefix"), ("InvalidS3Resource", "nothing below maps-bucket/lost/")),
        (source("maps/one.yaml", type="Archive"), ("InvalidInput", ".zip or .tar.gz")),
        (source("../one.yaml"), ("InvalidInput", "../one.yaml")),
        (source("maps/one.yaml", destination="/../etc"), ("InvalidInput", "'/../etc'")),
    ],
)
def test_what_cannot_be_fetched_is_told_with_robomakers_code(
    file_store: Store, bucket: Store, tmp_path: Path, asked: DataSourceConfig, why: tuple[str, str]
):
    found = pin_source(file_store, cache(tmp_path), asked)
    assert found.failure_code == why[0]
    assert why[1] in found.failure_reason
    assert found.failure_reason.startswith("data source maps: ")


def test_what_a_row_says_does_not_depend_on_where_the_store_is(bucket: Store, tmp_path: Path):
    elsewhere = open_store((tmp_path / "elsewhere").as_uri())
    open_bucket(elsewhere, "maps-bucket").put("other", b"")
    here = open_store(bucket.url.rpartition("/buckets/")[0])
    for asked in (source("maps/lost.yaml"), source("lost/", type="Prefix")):
        assert pin_source(here, cache(tmp_path), asked) == pin_source(elsewhere, cache(tmp_path), asked)


def test_a_bucket_that_is_not_there_is_no_jobs_fault(s3_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_BUCKETS", "s3://")
    with pytest.raises(StoreUnreachable, match="SIMYARD_BUCKETS"):
        pin_source(s3_store, cache(tmp_path), source("maps/one.yaml", s3Bucket="nobody-has-this"))


def test_planning_again_fetches_nothing_that_nobody_wrote(
    file_store: Store, bucket: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    first = pin_source(file_store, cache(tmp_path), source("maps/one.yaml"))
    fetched: list[str] = []
    download = type(bucket).download

    def counted(self: Store, key: str, target: Path) -> None:
        fetched.append(key)
        download(self, key, target)

    monkeypatch.setattr(type(bucket), "download", counted)
    again = pin_source(file_store, cache(tmp_path), source("maps/one.yaml"))
    assert again == first
    assert [file.etag for file in again.files] == [bucket.etag("maps/one.yaml").strip('"')]
    assert fetched == []
    bucket.put("maps/one.yaml", b"new")
    assert pin_source(file_store, cache(tmp_path), source("maps/one.yaml")) != first
    assert fetched == ["maps/one.yaml"]


def test_the_same_content_is_the_same_source_whatever_the_bucket_calls_it():
    file = PinnedFile(key="k", sha256="0" * 64, size_bytes=1)
    pinned = PinnedSource(name="a", bucket="b", type="File", destination="d", files=(file,))
    named = pinned.model_copy(update={"files": (file.model_copy(update={"etag": "5-2"}),)})
    assert (named.digest, named.model_dump(mode="json")) == (pinned.digest, pinned.model_dump(mode="json"))


def test_more_than_a_job_may_have_is_refused_for_all_its_sources():
    file = PinnedFile(key="k", sha256="0" * 64, size_bytes=1)
    half = PinnedSource(name="a", bucket="b", type="Prefix", destination="d", files=(file,) * 50)
    assert not any(each.failure_code for each in within_limits((half, half)))
    full = within_limits((half, half, half))
    assert {each.failure_code for each in full} == {"LimitExceeded"}
    big = half.model_copy(update={"files": (file.model_copy(update={"size_bytes": (25 << 30) + 1}),)})
    assert within_limits((big,))[0].failure_code == "LimitExceeded"
