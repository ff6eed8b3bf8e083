"""An export job ends in a record, whatever happens to its bucket, and can be done again after any death."""

import hashlib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from specs.base import canonical_document
from specs.errors import (
    BucketNotFound,
    IdempotentParameterMismatch,
    StoreAccessDenied,
    StoreAway,
    StoreDamaged,
    StoreError,
    StoreFull,
    StoreThrottled,
    StoreUnreachable,
)
from tasks.export.job.export_job import KIND, run_export_job
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
    break_bucket,
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
