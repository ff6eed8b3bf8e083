"""Exports into buckets of a real S3 server."""

import pytest

from specs.digests import canonical_document, canonical_json
from specs.world_jobs import CreateWorldExportJobRequest
from tasks.export.job import run_export_job
from tasks.storage.buckets import open_bucket
from tasks.storage.keys import world_key
from tasks.storage.records import JobRecord
from tasks.storage.store import Store
from tests.seaweed import READER_KEY, READER_SECRET, Seaweed
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
