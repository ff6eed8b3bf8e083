"""A job is cancelled by its record, and ends at once where nobody works on it."""

import pytest

from specs.errors import DocumentError, ResourceNotFound
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.jobs.records import advance, cancel_watched_job, read, submit

KIND = "world-export-job"


def test_a_job_that_nobody_works_on_is_canceled_at_once(file_store: Store) -> None:
    job = submit(file_store, KIND, {}, "one").id
    assert cancel_watched_job(file_store, KIND, job).status == "Canceled"


def test_whoever_works_on_a_job_is_left_to_end_it(file_store: Store) -> None:
    job = submit(file_store, KIND, {}, "one").id
    with hold_claim(file_store, claim_key(KIND, job), ttl_s=4.5):
        advance(file_store, KIND, job, "Running")
        assert cancel_watched_job(file_store, KIND, job).status == "Canceling"
    assert read(file_store, KIND, job).status == "Canceling"
    assert cancel_watched_job(file_store, KIND, job).status == "Canceled"


def test_an_ended_job_is_not_canceled(file_store: Store) -> None:
    job = submit(file_store, KIND, {}, "one").id
    advance(file_store, KIND, job, "Completed")
    with pytest.raises(DocumentError, match="Completed"):
        cancel_watched_job(file_store, KIND, job)


def test_a_job_that_does_not_exist_is_not_found(file_store: Store) -> None:
    with pytest.raises(ResourceNotFound):
        cancel_watched_job(file_store, KIND, "wxj-0")
