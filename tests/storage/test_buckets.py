from collections.abc import Callable
from pathlib import Path

import pytest

from specs.errors import DocumentError, StoreError, StoreUnreachable
from tasks.storage.base.store import Store
from tasks.storage.buckets import bucket_url, open_bucket


@pytest.fixture(autouse=True)
def no_buckets_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SIMYARD_BUCKETS", raising=False)


def test_a_bucket_lies_under_the_store_by_default(store: Store) -> None:
    bucket = open_bucket(store, "results")
    bucket.put("nightly/a.json", b"1")
    assert bucket.url == f"{store.url}/buckets/results"
    assert store.keys("buckets") == ["buckets/results/nightly/a.json"]


def test_a_folder_for_buckets_can_be_named(file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SIMYARD_BUCKETS", (tmp_path / "data").as_uri())
    open_bucket(file_store, "results").put("a.json", b"1")
    assert (tmp_path / "data" / "results" / "a.json").read_bytes() == b"1"


@pytest.mark.parametrize("link", ["store/buckets", "store/buckets/results", "data/results"])
def test_a_bucket_is_no_link_that_a_stranger_put_there(
    file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, link: str
) -> None:
    if link.startswith("data"):
        monkeypatch.setenv("SIMYARD_BUCKETS", (tmp_path / "data").as_uri())
    (tmp_path / "home" / "results").mkdir(parents=True)
    (tmp_path / link).parent.mkdir(exist_ok=True)
    (tmp_path / link).symlink_to(tmp_path / "home")
    with pytest.raises(StoreError, match="is a link"):
        open_bucket(file_store, "results")


def test_the_folder_that_is_named_for_buckets_may_be_a_link(
    file_store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "data").symlink_to(tmp_path / "disk")
    monkeypatch.setenv("SIMYARD_BUCKETS", (tmp_path / "data").as_uri())
    open_bucket(file_store, "results").put("a.json", b"1")
    assert (tmp_path / "disk" / "results" / "a.json").read_bytes() == b"1"


@pytest.mark.parametrize(
    ("root", "url"),
    [
        ("s3://", "s3://results"),
        ("s3://shared/outputs", "s3://shared/outputs/results"),
        ("s3://shared/", "s3://shared/results"),
        ("file:///data", "file:///data/results"),
    ],
)
def test_buckets_are_named_behind_the_prefix(
    file_store: Store, monkeypatch: pytest.MonkeyPatch, root: str, url: str
) -> None:
    monkeypatch.setenv("SIMYARD_BUCKETS", root)
    assert bucket_url(file_store, "results") == url


def test_a_missing_s3_bucket_is_named_with_the_variable_that_moves_it(
    s3_url: Callable[[], str], file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    s3_url()
    monkeypatch.setenv("SIMYARD_BUCKETS", "s3://")
    with pytest.raises(StoreUnreachable, match=r"bucket not-there .*does not exist.*SIMYARD_BUCKETS"):
        open_bucket(file_store, "not-there")


def test_an_s3_bucket_can_serve_a_store_in_a_folder(
    s3_url: Callable[[], str], file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SIMYARD_BUCKETS", s3_url())
    bucket = open_bucket(file_store, "results")
    bucket.put("a.json", b"1")
    assert bucket.get("a.json").body == b"1"


def test_a_name_that_is_no_buckets_is_refused(file_store: Store) -> None:
    with pytest.raises(DocumentError, match="s3Bucket"):
        open_bucket(file_store, "../outside")
