"""Files reach a bucket that fails now and then; what cannot be helped is told."""

import random
from pathlib import Path

import pytest

from specs.errors import (
    BucketNotFound,
    ObjectNotFound,
    StoreAccessDenied,
    StoreDamaged,
    StoreError,
    StoreThrottled,
    StoreUnreachable,
)
from tasks.export.job.export_job import put, upload
from tasks.storage.base.store import Store


@pytest.fixture
def waited_s(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What was waited between the attempts, without waiting it."""
    waits_s: list[float] = []
    monkeypatch.setattr("tasks.export.job.export_job.time.sleep", waits_s.append)
    return waits_s


@pytest.fixture
def source(tmp_path: Path) -> Path:
    (tmp_path / "source").write_bytes(b"body")
    return tmp_path / "source"


def fail(patch: pytest.MonkeyPatch, store: Store, method: str, *errors: StoreError) -> None:
    """Makes the first calls of a store's method raise these errors, and the later ones do what they should."""
    due, real = iter(errors), getattr(store, method)

    def call(*arguments: object) -> object:
        if error := next(due, None):
            raise error
        return real(*arguments)

    patch.setattr(store, method, call)


@pytest.mark.parametrize("error", [StoreDamaged("other bytes"), StoreUnreachable("gone"), StoreThrottled("slow down")])
def test_what_may_pass_is_tried_again(
    file_store: Store, source: Path, waited_s: list[float], monkeypatch: pytest.MonkeyPatch, error: StoreError
):
    fail(monkeypatch, file_store, "upload", error, error, error)
    upload(file_store, "a.zip", source)
    assert file_store.get("a.zip").body == b"body"
    assert len(waited_s) == 3


def test_after_the_last_attempt_the_error_is_told(
    file_store: Store, source: Path, waited_s: list[float], monkeypatch: pytest.MonkeyPatch
):
    fail(monkeypatch, file_store, "upload", *[StoreDamaged(str(number)) for number in range(5)])
    with pytest.raises(StoreDamaged, match="3"):
        upload(file_store, "a.zip", source)
    assert len(waited_s) == 3


@pytest.mark.parametrize("error", [BucketNotFound("none"), StoreAccessDenied("no")])
def test_what_does_not_pass_is_told_at_once(
    file_store: Store, waited_s: list[float], monkeypatch: pytest.MonkeyPatch, error: StoreError
):
    fail(monkeypatch, file_store, "put", error)
    with pytest.raises(type(error)):
        put(file_store, "a.svg", b"body")
    assert waited_s == []


def test_waits_are_spread_about_ever_longer_ones(
    file_store: Store, waited_s: list[float], monkeypatch: pytest.MonkeyPatch
):
    draws = iter([0.5, 1.0, 1.5] * 2)

    def uniform(_self: random.SystemRandom, low: float, high: float) -> float:
        assert (low, high) == (0.5, 1.5)
        return next(draws)

    monkeypatch.setattr(random.SystemRandom, "uniform", uniform)
    fail(monkeypatch, file_store, "put", *[StoreUnreachable("gone")] * 3)
    put(file_store, "a.svg", b"body")
    assert waited_s == [0.5, 3.0, 13.5]


def test_two_exports_that_failed_together_do_not_come_back_together(
    file_store: Store, waited_s: list[float], monkeypatch: pytest.MonkeyPatch
):
    for key in ("a.svg", "b.svg"):
        with monkeypatch.context() as patch:
            fail(patch, file_store, "put", StoreUnreachable("gone"))
            put(file_store, key, b"body")
    assert len(set(waited_s)) == 2
    assert all(0.5 <= wait_s <= 1.5 for wait_s in waited_s)


@pytest.mark.parametrize(
    "error",
    [
        StoreError("MethodNotAllowed (405)"),
        ObjectNotFound("NoSuchUpload (404)"),
        StoreAccessDenied("no"),
        StoreUnreachable("gone"),
    ],
)
def test_a_bucket_that_cannot_be_swept_gets_the_file_all_the_same(
    file_store: Store,
    source: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    error: StoreError,
):
    fail(monkeypatch, file_store, "sweep", error)
    upload(file_store, "a.zip", source)
    assert file_store.get("a.zip").body == b"body"
    assert str(error) in caplog.text
