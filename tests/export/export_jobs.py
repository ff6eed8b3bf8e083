"""Export jobs for tests: two worlds in a store, a request for them, buckets that fail or are cancelled meanwhile."""

from pathlib import Path

import pytest

from specs.base import canonical_document, canonical_json
from specs.data.world import World
from specs.errors import StoreAccessDenied
from specs.robomaker.world_jobs import CreateWorldExportJobRequest
from tasks.export.job.export_job import KIND, run_export_job
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tasks.storage.jobs.records import JobRecord, advance, submit
from tasks.storage.store_url import open_store
from tests.factories.worlds import apartment

GENERATION = "wgj-0000000000000001"
WORLDS = tuple(apartment(generation=GENERATION, name=f"world-{number}-1") for number in (1, 2))
TOKEN, OTHER_TOKEN = "first", "second"  # of client requests
ARNS = tuple(f"arn:simyard:world:0123456789ab:{GENERATION}/{world.name}" for world in WORLDS)


def keep(store: Store, world: World) -> None:
    """Puts a world into the store."""
    store.create(world_key(world.generation, world.name), canonical_json(canonical_document(world)))


def store_of_worlds(folder: Path) -> Store:
    """Returns a new store in a folder, with the two worlds."""
    store = open_store(folder.as_uri())
    for world in WORLDS:
        keep(store, world)
    return store


def request(*worlds: str, bucket: str | None = "worlds", prefix: str | None = "nightly") -> CreateWorldExportJobRequest:
    """Returns a request to export these worlds, or the two."""
    location = {"s3Bucket": bucket, "s3Prefix": prefix}
    return CreateWorldExportJobRequest.model_validate(
        {
            "worlds": worlds or ARNS,
            "outputLocation": {key: value for key, value in location.items() if value},
            "iamRole": "arn:aws:iam::111122223333:role/export",
        }
    )


def run(store: Store, wanted: CreateWorldExportJobRequest | None = None, token: str = TOKEN) -> JobRecord:
    """Returns the record of the export, ended; as MJCF and floor plans."""
    return run_export_job(store, wanted or request(), formats=("mjcf", "svg"), token=token, progress=lambda *_: None)


class BrokenBucket:
    """A bucket whose every write fails, after ``writes`` that do not."""

    def __init__(self, bucket: Store, error: BaseException, writes: int = 0) -> None:
        self.url = bucket.url
        self._bucket = bucket
        self._errors = iter([None] * writes)
        self._error = error

    def put(self, key: str, body: bytes) -> str:
        self._fail()
        return self._bucket.put(key, body)

    def upload(self, key: str, source: Path) -> None:
        self._fail()
        self._bucket.upload(key, source)

    def sweep(self, key: str) -> None:
        self._bucket.sweep(key)

    def _fail(self) -> None:
        if next(self._errors, self._error) is not None:
            raise self._error


def break_bucket(patch: pytest.MonkeyPatch, error: BaseException, writes: int = 0) -> None:
    """Makes every bucket that a job opens a broken one."""
    patch.setattr(
        "tasks.export.job.export_job.open_bucket", lambda s, b: BrokenBucket(open_bucket(s, b), error, writes)
    )


def cancel(store: Store, status: str = "Canceling") -> None:
    """Gives the job of ``run`` another status, as who cancels it does."""
    job = submit(store, KIND, {**canonical_document(request()), "formats": ["mjcf", "svg"]}, TOKEN)
    advance(store, KIND, job.id, status)


class CancelingBucket:
    """A bucket during whose write number ``at`` the job becomes cancelled; it may refuse to remove."""

    def __init__(self, store: Store, at: int, *, status: str = "Canceling", removes: bool = True) -> None:
        self._bucket = open_bucket(store, "worlds")
        self.url = self._bucket.url
        self._store, self._at, self._status, self._removes = store, at, status, removes
        self.writes = 0

    def put(self, key: str, body: bytes) -> str:
        self._count()
        return self._bucket.put(key, body)

    def upload(self, key: str, source: Path) -> None:
        self._count()
        self._bucket.upload(key, source)

    def sweep(self, key: str) -> None:
        self._bucket.sweep(key)

    def delete(self, key: str) -> None:
        if not self._removes:
            raise StoreAccessDenied("no removing")
        self._bucket.delete(key)

    def _count(self) -> None:
        self.writes += 1
        if self.writes == self._at:
            cancel(self._store, self._status)
