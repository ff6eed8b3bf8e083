"""A worker's attempts at a job, and the end of a job that cannot be done."""

import time
from collections.abc import Callable, Mapping
from typing import get_args

import pytest

from flows.queue.attempts import CODES, MOST_ATTEMPTS, Attempts, Job, ServerAway, fail_job
from specs.base import Fault
from specs.errors import DocumentError, ResourceNotFound, StoreAway, StoreError
from specs.job_kinds import JobKind
from specs.robomaker.failure_codes import DeploymentJobErrorCode, WorldExportJobErrorCode, WorldGenerationJobErrorCode
from specs.robomaker.simulation import SimulationJobBatchErrorCode
from tasks.applications.registry import publish_bundle
from tasks.export.job.export_answers import describe_export_job
from tasks.simulate.batch.batch_jobs import describe_batch
from tasks.storage.base.store import Store, encode_document
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.jobs.queue import change_entry, enqueue, find_entry, queued_jobs, turn_key
from tasks.storage.jobs.records import JobRecord, advance, job_id, read
from tasks.worlds.job.world_answers import describe_generation_job
from tests.flows.queue.queued_jobs import queue_batch, queue_export, queue_generation, queue_job, some_worlds
from tests.repository import ROOT

ROBOMAKERS: Mapping[JobKind, object] = {
    "world-generation-job": WorldGenerationJobErrorCode,
    "world-export-job": WorldExportJobErrorCode,
    "simulation-job-batch": SimulationJobBatchErrorCode,
    "deployment-job": DeploymentJobErrorCode,
}
KIND: JobKind = "world-export-job"


@pytest.mark.parametrize("kind", ROBOMAKERS)
def test_every_code_is_one_that_robomaker_has_for_the_kind(kind: JobKind):
    assert set(CODES[kind]) <= set(get_args(ROBOMAKERS[kind]))


def test_a_generation_that_failed_before_it_began_can_be_described(file_store: Store):
    ended = fail_job(file_store, queue_generation(file_store, "bad"), DocumentError([]))

    assert describe_generation_job(ended).failureCode == "InvalidInput"


def test_an_export_that_failed_can_be_described(file_store: Store):
    ended = fail_job(file_store, queue_export(file_store, ["wgj-1/world-1"], "bad"), "it killed its worker")

    described = describe_export_job(ended)
    assert (described.failureCode, described.failureReason) == ("InternalServiceError", "it killed its worker")


def test_a_deployment_that_failed_says_what_is_missing(file_store: Store):
    job = queue_job(file_store, "deployment-job", {"fleet": "couriers"}, "bad")
    missing = ResourceNotFound([Fault(path="fleet", value="'couriers'", allowed="a fleet")])

    ended = fail_job(file_store, job, missing)

    assert (ended.status, ended.failure_code) == ("Failed", "ResourceNotFound")


def test_the_jobs_of_a_batch_that_failed_before_it_began_say_why(file_store: Store):
    publish_bundle(file_store, "robot-application", "courier", ROOT / "applications/courier")
    publish_bundle(file_store, "simulation-application", "delivery", ROOT / "applications/delivery")
    ended = fail_job(file_store, queue_batch(file_store, some_worlds(file_store), "bad"), DocumentError([]))

    described = describe_batch(file_store, ended.id)

    assert described.failureCode == "InternalServiceError"
    assert {each.failureCode for each in described.failedRequests or ()} == {"InvalidInput"}


def test_a_job_that_is_being_canceled_is_canceled(file_store: Store):
    job = queue_generation(file_store, "stopped")
    advance(file_store, job.kind, job.id, "Canceling")

    assert fail_job(file_store, job, "it killed its worker").status == "Canceled"


def waiting(store: Store, kind: JobKind = KIND) -> JobRecord:
    return queue_job(store, kind, {"formats": []}, "one")


def attempt(store: Store, work: Callable[[Job], object], attempts: Attempts | None = None) -> bool:
    """Returns whether the queue's only job was attempted, however long it was put off."""
    (entry,) = queued_jobs(store)
    entry = change_entry(store, entry.kind, entry.id, not_before_s=0.0) or entry
    return (attempts or Attempts(store)).attempt(entry, work)


def raises(failure: BaseException) -> Callable[[Job], object]:
    def work(_job: Job) -> None:
        raise failure

    return work


def ends(store: Store) -> Callable[[Job], object]:
    return lambda job: advance(store, job.record.kind, job.record.id, "Completed")


def no_work(_job: Job) -> None:
    raise AssertionError("it was worked on")


def test_a_job_leaves_the_queue_when_it_has_ended(file_store: Store):
    waiting(file_store)

    assert attempt(file_store, ends(file_store))

    assert queued_jobs(file_store) == []
    assert not file_store.keys("claims")


def test_a_job_that_ended_while_its_worker_died_is_finished_by_another(file_store: Store):
    job, seen = waiting(file_store), list[str]()
    change_entry(file_store, KIND, job.id, attempts=1)
    advance(file_store, KIND, job.id, "Completed")

    attempt(file_store, lambda at_turn: seen.append(at_turn.record.status))

    assert (seen, queued_jobs(file_store)) == (["Completed"], [])


def test_a_job_that_a_live_worker_has_is_passed_by_at_once(file_store: Store):
    job = waiting(file_store)
    with hold_claim(file_store, turn_key(KIND, job.id)):
        assert not attempt(file_store, no_work)


def test_a_worker_that_has_died_is_followed_by_another(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    job = waiting(file_store)
    with hold_claim(file_store, turn_key(KIND, job.id)):
        monkeypatch.setattr("tasks.storage.jobs.claim.is_known_dead", lambda _process: True)
        assert attempt(file_store, ends(file_store))

    assert queued_jobs(file_store) == []


def test_a_job_that_kills_its_worker_each_time_fails_and_blocks_nobody(file_store: Store):
    job = waiting(file_store)
    for _ in range(MOST_ATTEMPTS):
        with pytest.raises(_Killed):
            attempt(file_store, raises(_Killed()), _Mortal(file_store))

    attempt(file_store, no_work)

    ended = read(file_store, KIND, job.id)
    assert (ended.status, ended.failure_code) == ("Failed", "InternalServiceError")
    assert queued_jobs(file_store) == []


def test_an_attempt_of_which_something_came_is_forgotten(file_store: Store):
    job = waiting(file_store, kind="world-generation-job")
    change_entry(file_store, job.kind, job.id, attempts=MOST_ATTEMPTS, done=0)
    file_store.put(f"worlds/{job.id}/world-1.json", b"{}")
    file_store.put(f"jobs/{job.kind}/{job.id}.json", _with_count(job))

    attempt(file_store, ends(file_store))

    assert read(file_store, job.kind, job.id).status == "Completed"


def test_a_roll_out_that_went_on_for_long_did_not_kill_its_worker(file_store: Store):
    job = waiting(file_store, "deployment-job")
    long_ago_s = time.time() - 3600
    change_entry(file_store, job.kind, job.id, attempts=3, begun_s=long_ago_s)

    attempt(file_store, lambda _: None)

    entry = find_entry(file_store, job.kind, job.id)
    assert entry
    assert entry.attempts == 1


@pytest.mark.parametrize("away", [StoreAway("no answer"), ServerAway("503")])
def test_a_store_or_a_server_that_is_away_is_waited_for_however_long(file_store: Store, away: Exception):
    job = waiting(file_store)

    for _ in range(2 * MOST_ATTEMPTS):
        attempt(file_store, raises(away))

    entry = find_entry(file_store, KIND, job.id)
    assert read(file_store, KIND, job.id).status == "Pending"
    assert entry
    assert entry.attempts == 0
    assert entry.not_before_s > time.time()


@pytest.mark.parametrize("failure", [StoreError("damaged"), ValueError("a defect")])
def test_what_cannot_be_done_fails_after_some_attempts(file_store: Store, failure: Exception):
    job = waiting(file_store)

    for number in range(MOST_ATTEMPTS):
        assert read(file_store, KIND, job.id).status == "Pending", number
        attempt(file_store, raises(failure))

    ended = read(file_store, KIND, job.id)
    assert (ended.status, ended.failure_code, ended.failure_reason) == ("Failed", "InternalServiceError", str(failure))


def test_what_is_refused_fails_at_once(file_store: Store):
    job = waiting(file_store)

    attempt(file_store, raises(DocumentError([])))

    ended = read(file_store, KIND, job.id)
    assert (ended.status, ended.failure_code) == ("Failed", "InvalidInput")


def test_a_process_that_is_ended_in_time_does_not_count(file_store: Store):
    job = waiting(file_store)

    with pytest.raises(SystemExit):
        attempt(file_store, raises(SystemExit()))

    entry = find_entry(file_store, KIND, job.id)
    assert entry
    assert entry.attempts == 0


def test_a_job_that_was_canceled_while_it_waited_is_not_begun(file_store: Store):
    job = waiting(file_store)
    advance(file_store, KIND, job.id, "Canceled")

    attempt(file_store, no_work)

    assert queued_jobs(file_store) == []


def test_an_entry_whose_job_was_never_recorded_leaves_after_a_while(file_store: Store, monkeypatch: pytest.MonkeyPatch):
    enqueue(file_store, KIND, job_id(KIND, "never"))
    assert not attempt(file_store, no_work)
    assert queued_jobs(file_store)

    later_s = time.time() + 61
    monkeypatch.setattr("flows.queue.attempts.time.time", lambda: later_s)
    attempt(file_store, no_work)

    assert queued_jobs(file_store) == []


def test_a_job_that_a_live_process_outside_of_the_queue_works_on_is_passed_by(file_store: Store):
    job = waiting(file_store)

    with hold_claim(file_store, f"claims/{KIND}/{job.id}.json"):
        assert not attempt(file_store, no_work)


def test_a_job_whose_record_is_damaged_keeps_nobody_from_the_others(file_store: Store):
    job = waiting(file_store)
    file_store.put(f"jobs/{KIND}/{job.id}.json", b"{")

    assert not attempt(file_store, no_work)

    entry = find_entry(file_store, KIND, job.id)
    assert entry
    assert entry.not_before_s > time.time()


def test_a_record_that_its_stage_cannot_read_is_counted_as_without_progress(file_store: Store):
    job = waiting(file_store, "simulation-job-batch")  # without a plan
    change_entry(file_store, job.kind, job.id, attempts=MOST_ATTEMPTS, done=0)

    attempt(file_store, no_work)

    ended = read(file_store, job.kind, job.id)
    assert (ended.status, ended.failure_code) == ("Failed", "InternalServiceError")


def test_a_record_that_a_stranger_changed_does_not_end_the_worker(file_store: Store):
    job = waiting(file_store, "deployment-job")
    strange = read(file_store, job.kind, job.id).model_copy(update={"status": "Strange"})
    file_store.put(f"jobs/{job.kind}/{job.id}.json", encode_document(strange))

    assert not attempt(file_store, raises(DocumentError([])))

    entry = find_entry(file_store, job.kind, job.id)
    assert entry
    assert entry.not_before_s > time.time()


class _Killed(BaseException):
    """What kill -9 looks like from the store: nothing is tidied up."""


class _Mortal(Attempts):
    """A worker that dies with its job, and so takes nothing back."""

    def _uncount(self, entry: object) -> None:
        """Does nothing: the process is gone."""


def _with_count(job: JobRecord) -> bytes:
    request = {**job.request, "worldCount": {"floorplanCount": 2}}
    return job.model_copy(update={"request": request}).model_dump_json().encode()
