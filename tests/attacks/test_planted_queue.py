"""A writer of the store puts a deployment into the queue of a worker that has keys, and all that it names."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from specs.base import canonical_document
from specs.robomaker.bundle import Version
from tasks.applications.registry import publish_bundle
from tasks.deploy.fleet.fleet_registry import read_desired
from tasks.deploy.trust.trust_record import vouch_queued
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import enqueue
from tasks.storage.jobs.records import is_terminal, job_id, read, submit
from tests.attacks.conftest import Owner, attacked_environment
from tests.deploy.yard import STAYS_UP
from tests.flows.queue.queued_jobs import deployment_request, queue_generation, queue_job
from tests.servers.eventually import eventually

KIND = "deployment-job"


@pytest.fixture(params=["file_store", "s3_store"])
def store(request: pytest.FixtureRequest) -> Store:
    """What the attacker writes to: a folder, and a bucket."""
    return request.getfixturevalue(request.param)


@pytest.fixture
def worker(store: Store, tmp_path: Path, attack_cache: Path, prefect_server: str) -> Iterator[None]:
    """A worker with keys, for a fleet of the owner's that has one robot."""
    (tmp_path / "owner").mkdir()
    variables = {"SIMYARD_STORE": store.url, "SIMYARD_CACHE": str(attack_cache), "SIMYARD_KEYS": str(tmp_path / "keys")}
    owner = Owner(store.url, tmp_path / "owner", {**os.environ, **attacked_environment(), **variables})
    for command in ("fleet keys init", "fleet create couriers", "fleet register couriers r1"):
        done = owner.simyard(*command.split())
        assert done.returncode == 0, done.stdout
    process = owner.start("worker")
    try:
        yield
    finally:
        process.terminate()
        process.communicate()


def _published(store: Store, folder: Path) -> Version:
    package = folder / "bundle/courier"
    package.mkdir(parents=True)
    (package / "run.sh").write_text(STAYS_UP)
    (package / "run.sh").chmod(0o755)
    return publish_bundle(store, "robot-application", "courier", package.parent)


def test_a_deployment_that_was_put_into_the_queue_is_not_signed(store: Store, worker: None, tmp_path: Path) -> None:
    _published(store, tmp_path)
    job = queue_job(store, KIND, canonical_document(deployment_request(store, "couriers", "evil")), "evil")

    eventually(lambda: is_terminal(read(store, KIND, job.id)) or read_desired(store, "r1")[0] is not None)

    asked, _ = read_desired(store, "r1")
    assert asked is None or asked.signature is None, f"signed for r1: {asked}"
    ended = read(store, KIND, job.id)
    assert (ended.status, "does not vouch for it" in ended.failure_reason) == ("Failed", True)


@pytest.mark.parametrize("store", ["file_store"], indirect=True)
def test_no_other_job_that_was_put_into_the_queue_is_begun(store: Store, worker: None) -> None:
    job = queue_generation(store, "evil")
    eventually(lambda: is_terminal(read(store, job.kind, job.id)))
    ended = read(store, job.kind, job.id)
    assert (ended.status, "does not vouch for it" in ended.failure_reason) == ("Failed", True)
    assert store.keys("worlds") == []


@pytest.mark.parametrize("store", ["file_store"], indirect=True)
def test_a_deployment_that_the_owner_queued_is_signed(
    store: Store, worker: None, tmp_path: Path, attack_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SIMYARD_CACHE", str(attack_cache))  # where her key is
    version = _published(store, tmp_path)
    request = canonical_document(deployment_request(store, "couriers", "own"))
    enqueue(store, KIND, job_id(KIND, "own"))
    vouched = vouch_queued(job_id(KIND, "own"), request, version.digest, version.digests)
    submit(store, KIND, request, "own", detail=vouched)

    eventually(lambda: read_desired(store, "r1")[0] is not None)

    asked, _ = read_desired(store, "r1")
    assert asked is not None
    assert asked.signature is not None
