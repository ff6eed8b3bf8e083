"""An export job ends in a record, whatever happens to its bucket, and can be done again after any death."""

import hashlib
import random
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from specs.base import canonical_document
from specs.errors import (
    BucketNotFound,
    IdempotentParameterMismatch,
    ObjectNotFound,
    StoreAccessDenied,
    StoreAway,
    StoreDamaged,
    StoreError,
    StoreFull,
    StoreThrottled,
    StoreUnreachable,
)
from tasks.export.job.export_job import KIND, put, run_export_job, upload
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.records import read, records, submit
from tests.export.export_jobs import (
    ARNS,
    GENERATION,
    OTHER_TOKEN,
    TOKEN,
    WORLDS,
    CancelingBucket,
    break_bucket,
    cancel,
    keep,
    request,
    run,
    store_of_worlds,
)
from tests.factories.worlds import apartment


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    monkeypatch.delenv("SIMYARD_BUCKETS", raising=False)
    return store_of_worlds(tmp_path / "store")


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    with monkeypatch.context() as patch:
        patch.setattr("tasks.export.job.export_job._WAITS_S", (0.0, 0.0))
        yield patch


def test_a_completed_job_says_where_the_zip_and_the_plans_lie(store: Store):
    record = run(store)
    bucket = open_bucket(store, "worlds")
    assert record.status == "Completed"
    assert record.detail["zip"] == f"{bucket.url}/nightly/{record.id}.zip"
    assert record.detail["svg"] == [f"{bucket.url}/nightly/{record.id}/world-{number}-1.svg" for number in (1, 2)]
    assert hashlib.sha256(bucket.get(f"nightly/{record.id}.zip").body).hexdigest() == record.detail["sha256"]
    assert bucket.get(f"nightly/{record.id}/world-2-1.svg").body.startswith(b"<svg")


def test_worlds_may_be_named_by_old_arns_and_the_order_changes_no_byte(store: Store):
    old = [f"arn:aws:robomaker:us-west-2:111122223333:world/{GENERATION}/{world.name}" for world in WORLDS]
    first = run(store)
    second = run(store, request(*reversed(old)), token=OTHER_TOKEN)
    assert first.detail["sha256"] == second.detail["sha256"]


def test_the_zip_holds_each_world_of_the_request_once(store: Store, tmp_path: Path):
    record = run(store, request(ARNS[0], ARNS[0]))
    open_bucket(store, "worlds").download(f"nightly/{record.id}.zip", tmp_path / "out.zip")
    with zipfile.ZipFile(tmp_path / "out.zip") as bundle:
        worlds = [name for name in bundle.namelist() if name.startswith("world/")]
    assert worlds == [f"world/{GENERATION}/world-1-1.json"]


def test_plans_of_worlds_with_one_name_do_not_overwrite_each_other(store: Store):
    keep(store, apartment(generation="wgj-2", name="world-1-1"))
    record = run(store, request(ARNS[0], "arn:simyard:world:0123456789ab:wgj-2/world-1-1"))
    plans = record.detail["svg"]
    assert isinstance(plans, list)
    assert len(set(map(str, plans))) == 2


def test_progress_counts_every_world(store: Store):
    told: list[tuple[int, int]] = []
    run_export_job(
        store, request(), formats=("svg",), token=TOKEN, progress=lambda done, total: told.append((done, total))
    )
    assert told == [(1, 2), (2, 2)]


def test_the_same_token_and_request_is_the_same_job(store: Store):
    first = run(store)
    assert run(store) == first


def test_the_same_token_with_other_formats_is_refused(store: Store):
    run(store)
    with pytest.raises(IdempotentParameterMismatch):
        run_export_job(store, request(), formats=("svg",), token=TOKEN, progress=lambda *_: None)


def test_a_world_that_does_not_exist_fails_the_job_as_resource_not_found(store: Store):
    record = run(store, request(ARNS[0], f"arn:simyard:world:0123456789ab:{GENERATION}/world-9-9"))
    assert (record.status, record.failure_code) == ("Failed", "ResourceNotFound")
    assert "world-9-9" in record.failure_reason


def test_nothing_is_uploaded_when_a_world_is_missing(store: Store):
    run(store, request(ARNS[0], f"arn:simyard:world:0123456789ab:{GENERATION}/world-9-9"))
    assert open_bucket(store, "worlds").keys("") == []


@pytest.mark.parametrize("text", ["arn:simyard:robot:0123456789ab:r1", "arn:simyard:world:0123456789ab:only-a-name"])
def test_what_is_no_world_fails_the_job_as_invalid_input(store: Store, text: str):
    record = run(store, request(text))
    assert (record.status, record.failure_code) == ("Failed", "InvalidInput")
    assert text in record.failure_reason


def test_a_request_without_a_bucket_fails_as_invalid_input(store: Store):
    record = run(store, request(bucket=None))
    assert (record.status, record.failure_code) == ("Failed", "InvalidInput")
    assert "s3Bucket" in record.failure_reason


def test_a_request_without_a_prefix_writes_to_the_top_of_the_bucket(store: Store):
    record = run(store, request(prefix=None))
    assert record.detail["zip"] == f"{open_bucket(store, 'worlds').url}/{record.id}.zip"


def test_a_world_of_another_version_fails_as_invalid_input(store: Store):
    store.create(world_key(GENERATION, "world-old"), b'{"version": "0"}')
    record = run(store, request(f"arn:simyard:world:0123456789ab:{GENERATION}/world-old"))
    assert (record.status, record.failure_code) == ("Failed", "InvalidInput")


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (StoreAccessDenied("no"), "AccessDenied"),
        (BucketNotFound("gone"), "ResourceNotFound"),
        (StoreUnreachable("no answer"), "InternalServiceError"),
        (StoreThrottled("slow down"), "RequestThrottled"),
        (StoreFull("no room"), "LimitExceeded"),
        (StoreDamaged("other bytes"), "InternalServiceError"),
        (StoreError("disk full\nreally"), "InternalServiceError"),
    ],
)
@pytest.mark.parametrize("writes", [0, 1])
def test_what_the_bucket_refuses_becomes_a_code(
    store: Store, broken: pytest.MonkeyPatch, error: StoreError, code: str, writes: int
):
    break_bucket(broken, error, writes)
    record = run(store)
    assert (record.status, record.failure_code) == ("Failed", code)
    assert "\n" not in record.failure_reason


@pytest.mark.parametrize("writes", [0, 1])
def test_a_job_whose_bucket_is_away_goes_on_when_it_answers_again(
    store: Store, broken: pytest.MonkeyPatch, writes: int
):
    break_bucket(broken, StoreAway("no answer"), writes)
    with pytest.raises(StoreAway):
        run(store)
    (left,) = records(store, KIND)
    assert left.status == "Running"
    broken.undo()
    assert run(store).status == "Completed"


def test_a_job_killed_between_two_uploads_is_completed_by_the_next_run(store: Store, broken: pytest.MonkeyPatch):
    break_bucket(broken, KeyboardInterrupt(), writes=1)
    with pytest.raises(KeyboardInterrupt):
        run(store)
    job = submit(store, KIND, {**canonical_document(request()), "formats": ["mjcf", "svg"]}, TOKEN)
    assert read(store, KIND, job.id).status == "Running"
    broken.undo()
    assert run(store).status == "Completed"
    assert len(open_bucket(store, "worlds").keys("")) == 3


def test_the_zip_comes_last_so_that_where_it_lies_all_lies(store: Store, broken: pytest.MonkeyPatch):
    break_bucket(broken, StoreAccessDenied("no"), writes=2)
    run(store)
    assert [key.endswith(".svg") for key in open_bucket(store, "worlds").keys("")] == [True, True]


def test_a_bucket_that_answers_again_gets_everything(store: Store, broken: pytest.MonkeyPatch):
    bucket = open_bucket(store, "worlds")
    uploads = iter([StoreThrottled("slow down"), StoreUnreachable("no answer")])

    def upload(key: str, source: Path) -> None:
        error = next(uploads, None)
        if error:
            raise error
        type(bucket).upload(bucket, key, source)

    broken.setattr(bucket, "upload", upload)
    broken.setattr("tasks.export.job.export_job.open_bucket", lambda _store, _name: bucket)
    assert run(store).status == "Completed"
    assert next(uploads, None) is None


def test_a_format_whose_library_is_missing_fails_the_job_and_says_what_to_install(
    store: Store, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("tasks.export.format.formats.find_spec", lambda _: None)
    record = run_export_job(store, request(), formats=("usd",), token=TOKEN, progress=lambda *_: None)
    assert (record.status, record.failure_code) == ("Failed", "InvalidInput")
    assert "pip install 'simyard[usd]'" in record.failure_reason


def test_a_job_that_is_being_canceled_ends_canceled_and_uploads_nothing(store: Store):
    cancel(store)
    assert run(store).status == "Canceled"
    assert open_bucket(store, "worlds").keys("") == []


def test_a_job_that_is_canceled_among_its_worlds_stops_there_and_uploads_nothing(store: Store):
    def cancel_after_one(done: int, _total: int) -> None:
        assert done == 1
        cancel(store)

    record = run_export_job(store, request(), formats=("mjcf", "svg"), token=TOKEN, progress=cancel_after_one)
    assert record.status == "Canceled"
    assert open_bucket(store, "worlds").keys("") == []


@pytest.mark.parametrize("status", ["Canceling", "Canceled"])  # the latter by another, who took this run for dead
@pytest.mark.parametrize("at", [1, 2, 3])  # two plans, the zip
def test_a_job_that_is_canceled_among_its_uploads_stops_there_and_leaves_nothing(
    store: Store, monkeypatch: pytest.MonkeyPatch, at: int, status: str
):
    bucket = CancelingBucket(store, at, status=status)
    monkeypatch.setattr("tasks.export.job.export_job.open_bucket", lambda _store, _name: bucket)
    assert run(store).status == "Canceled"
    assert bucket.writes == at
    assert open_bucket(store, "worlds").keys("") == []


def test_a_canceled_job_ends_canceled_where_nothing_may_be_removed_and_says_so(
    store: Store, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    bucket = CancelingBucket(store, 1, removes=False)
    monkeypatch.setattr("tasks.export.job.export_job.open_bucket", lambda _store, _name: bucket)
    assert run(store).status == "Canceled"
    assert "no removing" in caplog.text


def test_a_canceled_job_leaves_nothing_of_a_run_that_was_killed_either(store: Store, monkeypatch: pytest.MonkeyPatch):
    with monkeypatch.context() as broken:
        break_bucket(broken, KeyboardInterrupt(), writes=2)
        with pytest.raises(KeyboardInterrupt):
            run(store)
    assert len(open_bucket(store, "worlds").keys("")) == 2

    def cancel_after_one(_done: int, _total: int) -> None:
        cancel(store)

    record = run_export_job(store, request(), formats=("mjcf", "svg"), token=TOKEN, progress=cancel_after_one)
    assert record.status == "Canceled"
    assert open_bucket(store, "worlds").keys("") == []


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
