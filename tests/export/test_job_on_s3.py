"""Exports into buckets of a real S3 server."""

import time
from multiprocessing import get_context
from pathlib import Path
from unittest.mock import patch

import botocore.session
import pytest

from specs.digests import canonical_document, canonical_json
from specs.world_jobs import CreateWorldExportJobRequest
from tasks.export.job import run_export_job
from tasks.storage.buckets import open_bucket
from tasks.storage.keys import world_key
from tasks.storage.opening import open_store
from tasks.storage.records import JobRecord
from tasks.storage.store import Store
from tests.seaweed import READER_KEY, READER_SECRET, Seaweed
from tests.storage.faulty_proxy import faulty_proxy
from tests.worlds_factory import apartment

pytestmark = pytest.mark.integration
WORLD = apartment()


def run(store: Store, bucket: str) -> JobRecord:
    store.put(world_key(WORLD.generation, WORLD.name), canonical_json(canonical_document(WORLD)))
    request = CreateWorldExportJobRequest.model_validate(
        {
            "worlds": [f"arn:simyard:world:0123456789ab:{WORLD.generation}/{WORLD.name}"],
            "outputLocation": {"s3Bucket": bucket, "s3Prefix": "nightly"},
            "iamRole": "arn:aws:iam::111122223333:role/export",
        }
    )
    return run_export_job(store, request, formats=("mjcf", "svg"), token=bucket, progress=lambda *_: None)


@pytest.fixture
def buckets_on_s3(seaweed: Seaweed, monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    for name, value in {**seaweed.environment(), "SIMYARD_BUCKETS": "s3://"}.items():
        monkeypatch.setenv(name, value)
    return monkeypatch


def test_a_bucket_gets_the_same_bytes_as_a_folder(file_store: Store, buckets_on_s3: pytest.MonkeyPatch):
    on_s3 = run(file_store, "tests")
    body = open_bucket(file_store, "tests").get(f"nightly/{on_s3.id}.zip").body
    buckets_on_s3.delenv("SIMYARD_BUCKETS")
    in_folder = run(file_store, "folder")
    assert on_s3.status == in_folder.status == "Completed"
    assert on_s3.detail["zip"] == f"s3://tests/nightly/{on_s3.id}.zip"
    assert body == open_bucket(file_store, "folder").get(f"nightly/{in_folder.id}.zip").body


@pytest.mark.usefixtures("buckets_on_s3")
def test_a_bucket_that_does_not_exist_is_resource_not_found(file_store: Store):
    record = run(file_store, "no-such-bucket")
    assert (record.status, record.failure_code) == ("Failed", "ResourceNotFound")
    assert "no-such-bucket" in record.failure_reason


def test_a_bucket_that_may_only_be_read_is_access_denied(file_store: Store, buckets_on_s3: pytest.MonkeyPatch):
    buckets_on_s3.setenv("AWS_ACCESS_KEY_ID", READER_KEY)
    buckets_on_s3.setenv("AWS_SECRET_ACCESS_KEY", READER_SECRET)
    record = run(file_store, "tests")
    assert (record.status, record.failure_code) == ("Failed", "AccessDenied")


def test_wrong_credentials_are_access_denied(file_store: Store, buckets_on_s3: pytest.MonkeyPatch):
    buckets_on_s3.setenv("AWS_SECRET_ACCESS_KEY", "wrong")
    record = run(file_store, "tests")
    assert (record.status, record.failure_code) == ("Failed", "AccessDenied")


def _killed_while_uploading(store_url: str, bucket: str) -> None:
    """Runs in a process of its own: an export whose zip takes a while to upload."""

    def write_big(_worlds: object, _formats: object, target: Path) -> str:
        with target.open("wb") as file:
            file.truncate(512 << 20)
        return "not yet"

    with patch("tasks.export.job.write_zip", write_big):
        run(open_store(store_url), bucket)


def test_an_export_killed_during_its_upload_shows_nothing_finished_and_is_completed_by_the_next_run(
    file_store: Store, buckets_on_s3: pytest.MonkeyPatch, seaweed: Seaweed
):
    seaweed.make_bucket("killed")
    child = get_context("spawn").Process(target=_killed_while_uploading, args=(file_store.url, "killed"))
    child.start()
    while not _uploads(seaweed, "killed"):
        assert child.is_alive()
        time.sleep(0.01)
    child.kill()
    child.join()
    bucket = open_bucket(file_store, "killed")
    assert not [key for key in bucket.keys("") if key.endswith(".zip")]
    record = run(file_store, "killed")
    assert record.status == "Completed"
    assert bucket.exists(f"nightly/{record.id}.zip")
    assert _uploads(seaweed, "killed") == []


def test_a_server_that_goes_away_during_the_upload_fails_the_job_and_shows_nothing(
    file_store: Store, buckets_on_s3: pytest.MonkeyPatch, seaweed: Seaweed
):
    seaweed.make_bucket("cut-off")
    with faulty_proxy(seaweed.endpoint) as proxy:
        buckets_on_s3.setenv("AWS_ENDPOINT_URL_S3", proxy.endpoint)
        buckets_on_s3.setattr("tasks.export.uploading._WAITS_S", (0.1,))
        bucket = open_bucket(file_store, "cut-off")
        upload = type(bucket).upload

        def cut_off(self: Store, key: str, source: Path) -> None:
            proxy.close()
            upload(self, key, source)

        buckets_on_s3.setattr(type(bucket), "upload", cut_off)
        record = run(file_store, "cut-off")
    assert (record.status, record.failure_code) == ("Failed", "InternalServiceError")
    buckets_on_s3.setenv("AWS_ENDPOINT_URL_S3", seaweed.endpoint)
    assert not [key for key in open_bucket(file_store, "cut-off").keys("") if key.endswith(".zip")]


def _uploads(seaweed: Seaweed, bucket: str) -> list[object]:
    client = botocore.session.Session().create_client("s3", endpoint_url=seaweed.endpoint)
    try:
        return client.list_multipart_uploads(Bucket=bucket).get("Uploads", [])
    finally:
        client.close()
