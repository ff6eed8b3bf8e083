"""Exports into buckets of a real S3 server."""

import json
import time
from collections.abc import Collection, Sequence
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path
from unittest.mock import patch
from zipfile import ZipFile

import botocore.session
import pytest

from specs.base import canonical_document, canonical_json
from specs.data.world import World
from specs.errors import StoreAway
from specs.pipeline.world_sections import FORMATS, WorldFormat
from specs.robomaker.world_jobs import CreateWorldExportJobRequest
from tasks.export.format.formats import format_files
from tasks.export.job.export_job import KIND, run_export_job
from tasks.storage.archives import digest_of
from tasks.storage.backends.s3_client import S3Client
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.records import JobRecord, records
from tasks.storage.store_url import open_store
from tests.factories.worlds import apartment
from tests.servers.faulty_proxy import faulty_proxy
from tests.servers.seaweed import READER_KEY, READER_SECRET, Seaweed

pytestmark = [pytest.mark.integration, pytest.mark.long]
WORLD = apartment()


def run(
    store: Store, bucket: str, worlds: Sequence[World] = (WORLD,), formats: Collection[WorldFormat] = ("mjcf", "svg")
) -> JobRecord:
    for world in worlds:
        store.put(world_key(world.generation, world.name), canonical_json(canonical_document(world)))
    request = CreateWorldExportJobRequest.model_validate(
        {
            "worlds": [f"arn:simyard:world:0123456789ab:{world.generation}/{world.name}" for world in worlds],
            "outputLocation": {"s3Bucket": bucket, "s3Prefix": "nightly"},
            "iamRole": "arn:aws:iam::111122223333:role/export",
        }
    )
    return run_export_job(store, request, formats=formats, token=f"{bucket}-{len(worlds)}", progress=lambda *_: None)


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

    with patch("tasks.export.job.export_job.write_zip", write_big):
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


def _export_that_is_cut(
    store: Store, patch: pytest.MonkeyPatch, seaweed: Seaweed, bucket_name: str, after_bytes: int
) -> JobRecord:
    """Returns the record of an export whose network is gone for good after so many bytes of its zip."""
    with faulty_proxy(seaweed.endpoint) as proxy, patch.context() as cut:
        cut.setenv("AWS_ENDPOINT_URL_S3", proxy.endpoint)
        cut.setattr("tasks.export.job.export_job._WAITS_S", (0.1,))
        send = S3Client.send

        def send_and_be_cut(self: S3Client, source: Path, bucket: str, key: str) -> None:
            if not proxy.is_cut:
                assert source.stat().st_size > after_bytes
                proxy.cut_after(after_bytes)
            send(self, source, bucket, key)

        cut.setattr(S3Client, "send", send_and_be_cut)
        with pytest.raises(StoreAway):
            run(store, bucket_name)
        assert proxy.is_cut
    (record,) = records(store, KIND)
    return record


def test_a_server_that_goes_away_in_the_middle_of_the_upload_shows_nothing_until_the_job_is_continued(
    file_store: Store, buckets_on_s3: pytest.MonkeyPatch, seaweed: Seaweed
):
    seaweed.make_bucket("cut-off")
    record = _export_that_is_cut(file_store, buckets_on_s3, seaweed, "cut-off", after_bytes=8192)
    assert record.status == "Running"
    assert not [key for key in open_bucket(file_store, "cut-off").keys("") if key.endswith(".zip")]
    assert run(file_store, "cut-off").status == "Completed"


@pytest.mark.usefixtures("buckets_on_s3")
def test_an_export_of_several_worlds_in_all_formats_is_read_back_as_its_manifest_says(
    file_store: Store, tmp_path: Path
):
    worlds = [apartment(name=f"world-{number}-1") for number in range(1, 11)]
    record = run(file_store, "tests", worlds, FORMATS)
    assert record.status == "Completed"
    bucket = open_bucket(file_store, "tests")
    bucket.download(f"nightly/{record.id}.zip", tmp_path / "worlds.zip")
    assert digest_of(tmp_path / "worlds.zip") == record.detail["sha256"]
    with ZipFile(tmp_path / "worlds.zip") as bundle:
        manifest = json.loads(bundle.read("manifest.json"))
        found = {name: bundle.read(name) for name in bundle.namelist() if name != "manifest.json"}
    facts = {name: {"sha256": sha256(body).hexdigest(), "bytes": len(body)} for name, body in found.items()}
    assert manifest == {"formats": [*FORMATS], "files": facts}
    for world in worlds:
        files: dict[str, bytes] = {}
        for name in FORMATS:
            files |= format_files(world, name)
        assert {path: found.get(path) for path in files} == files
        plan = bucket.get(f"nightly/{record.id}/{world.name}.svg").body
        assert plan == files[f"svg/{world.generation}/{world.name}.svg"]


def _uploads(seaweed: Seaweed, bucket: str) -> list[object]:
    client = botocore.session.Session().create_client("s3", endpoint_url=seaweed.endpoint)
    try:
        return client.list_multipart_uploads(Bucket=bucket).get("Uploads", [])
    finally:
        client.close()
