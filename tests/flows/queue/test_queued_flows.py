"""The contract between the gateway and a worker: what is submitted again must be what was recorded."""

import pytest

from flows.queue.queued_flows import work_off
from specs.errors import SimyardError, TrustRefused
from tasks.deploy.trust.trust_record import vouch_queued
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import advance, read
from tests.flows.queue.queued_jobs import queue_batch, queue_export, queue_generation, queue_job, some_worlds


def test_a_recorded_generation_makes_its_worlds_and_their_picture(file_store: Store):
    job = queue_generation(file_store, "one")

    made = work_off(file_store, job, {})

    assert made.status == "Completed"
    assert made.request_digest == job.request_digest
    assert file_store.exists(f"worlds/{job.id}/contact-sheet.svg")


def test_a_recorded_export_writes_its_zip(file_store: Store):
    job = queue_export(file_store, some_worlds(file_store), "one")

    made = work_off(file_store, job, {})

    assert (made.status, made.request_digest) == ("Completed", job.request_digest)


def test_an_ended_job_stays_as_it_ended(file_store: Store):
    job = queue_export(file_store, some_worlds(file_store), "one")
    ended = advance(file_store, job.kind, job.id, "Canceled")

    assert work_off(file_store, job, {}) == ended


def test_a_job_that_is_being_canceled_ends_canceled(file_store: Store):
    job = queue_generation(file_store, "one", floorplans=2)
    advance(file_store, job.kind, job.id, "Canceling")

    work_off(file_store, job, {})

    assert read(file_store, job.kind, job.id).status == "Canceled"


def test_a_worker_with_keys_takes_only_what_the_owner_vouched_for(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    worlds = some_worlds(file_store)
    monkeypatch.setenv("SIMYARD_KEYS", "keys")
    planted = [queue_generation(file_store, "made"), queue_export(file_store, worlds, "exported")]
    for job in (*planted, queue_batch(file_store, worlds, "simulated")):
        with pytest.raises(TrustRefused, match=f"{job.id} is not signed: the key .* does not vouch for it"):
            work_off(file_store, job, {})
        assert read(file_store, job.kind, job.id) == job

    made = planted[0]
    vouched = made.model_copy(update={"detail": vouch_queued(made.id, made.request)})
    assert work_off(file_store, vouched, {}).status == "Completed"


def test_a_worker_with_keys_ends_what_was_cancelled_whoever_asked_for_it(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("SIMYARD_KEYS", "keys")
    job = queue_generation(file_store, "one", floorplans=2)
    assert work_off(file_store, advance(file_store, job.kind, job.id, "Canceling"), {}).status == "Canceled"


def test_a_run_of_a_document_is_nothing_for_the_queue(file_store: Store):
    with pytest.raises(SimyardError, match="not queued"):
        work_off(file_store, queue_job(file_store, "pipeline-run", {}, "one"), {})
