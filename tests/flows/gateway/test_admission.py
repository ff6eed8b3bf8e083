"""How a job is admitted when several gateways are asked at once, or one dies in between."""

import threading
from collections.abc import Callable
from typing import Any

import pytest

from flows.gateway.admission import SINGLE, require_place
from specs.errors import ConcurrentDeployment, DocumentError, LimitExceeded, SimyardError
from specs.robomaker.operations import SIMULATION_JOBS
from tasks.simulate.batch.batch_record import KIND as BATCH
from tasks.storage.base.keys import job_key
from tasks.storage.jobs.queue import is_queued, leave_queue, queued_jobs
from tasks.storage.jobs.records import advance, job_id, read, submit
from tests.flows.gateway.asked import Asked, path

_AT_ONCE = 8


def at_once(calls: list[Callable[[], dict[str, Any]]]) -> list[dict[str, Any] | SimyardError]:
    """Returns what came of calls that are made at the same moment, each by a gateway of its own."""
    barrier = threading.Barrier(len(calls))
    answers: list[dict[str, Any] | SimyardError] = []

    def make(call: Callable[[], dict[str, Any]]) -> None:
        barrier.wait()
        try:
            answers.append(call())
        except SimyardError as exc:
            answers.append(exc)

    threads = [threading.Thread(target=make, args=(call,)) for call in calls]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return answers


def test_a_refused_call_whose_twin_has_recorded_the_job_leaves_it_queued(asked: Asked):
    job = job_id(BATCH, "same")

    def refused_late() -> None:
        with require_place(asked.store, BATCH, job, SIMULATION_JOBS, {SINGLE: True}):
            submit(asked.store, BATCH, {}, "same")
            raise LimitExceeded([])

    with pytest.raises(LimitExceeded):
        refused_late()
    assert [(entry.id, entry.options) for entry in queued_jobs(asked.store)] == [(job, {SINGLE: True})]


def test_equal_calls_at_once_are_one_job(asked: Asked):
    request = asked.job_request(asked.world(), clientRequestToken="same")
    answers = at_once([lambda: Asked(asked.store).call("CreateSimulationJob", **request)] * _AT_ONCE)
    assert [answer == answers[0] and not isinstance(answer, SimyardError) for answer in answers] == [True] * _AT_ONCE
    assert len(queued_jobs(asked.store)) == 1


def test_calls_at_once_never_exceed_a_quota(asked: Asked, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_MAX_SIMULATION_JOBS", "3")
    request = asked.job_request(asked.world())
    answers = at_once([lambda: Asked(asked.store).call("CreateSimulationJob", **request)] * _AT_ONCE)
    made = [answer for answer in answers if isinstance(answer, dict)]
    assert len(made) <= 3
    assert all(isinstance(answer, LimitExceeded) for answer in answers if not isinstance(answer, dict))
    assert {entry.id for entry in queued_jobs(asked.store)} == {path(answer).partition("/")[0] for answer in made}


def test_a_strange_entry_of_a_full_queue_takes_no_place(asked: Asked, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("SIMYARD_MAX_SIMULATION_JOBS", "1")
    asked.store.put(f"queue/{BATCH}/strange.json", b"[]")
    request = asked.job_request(asked.world())
    asked.call("CreateSimulationJob", **request)
    with pytest.raises(LimitExceeded):
        asked.call("CreateSimulationJob", **request)


def test_of_deployments_to_one_fleet_at_once_one_is_made(asked: Asked):
    fleet = asked.fleet()

    def call(name: str) -> Callable[[], dict[str, Any]]:
        return lambda: Asked(asked.store).call("CreateDeploymentJob", **asked.deployment_request(fleet, name))

    answers = at_once([call(f"d{number}") for number in range(_AT_ONCE)])
    (made,) = [answer for answer in answers if isinstance(answer, dict)]
    assert sum(isinstance(answer, ConcurrentDeployment) for answer in answers) == _AT_ONCE - 1
    assert [entry.id for entry in queued_jobs(asked.store)] == [path(made)]


def test_a_call_again_completes_what_a_gateway_that_died_has_left(asked: Asked):
    request = asked.job_request(asked.world(), clientRequestToken="t")
    first = asked.call("CreateSimulationJob", **request)
    batch = path(first).partition("/")[0]
    asked.store.delete(job_key(BATCH, batch))  # it had queued it, and written the token
    assert asked.call("CreateSimulationJob", **request)["arn"] == first["arn"]
    assert read(asked.store, BATCH, batch).status == "Pending"


def test_a_token_without_a_job_is_free_though_a_version_was_published_since(asked: Asked):
    request = asked.job_request(asked.world(), clientRequestToken="t")
    submit(asked.store, BATCH, {"request": request, "plan": "another"}, "t")
    asked.store.delete(job_key(BATCH, job_id(BATCH, "t")))
    assert asked.call("CreateSimulationJob", **request)["status"] == "Pending"


def test_the_token_of_a_documents_job_is_nobody_elses(asked: Asked):
    request = asked.job_request(asked.world(), clientRequestToken="run-0123456789abcdef-batch")
    with pytest.raises(DocumentError, match="clientRequestToken"):
        asked.call("CreateSimulationJob", **request)


def test_a_job_whose_entry_was_taken_for_one_of_no_job_is_queued_again(asked: Asked):
    request = asked.job_request(asked.world(), clientRequestToken="t")
    batch = path(asked.call("CreateSimulationJob", **request)).partition("/")[0]
    leave_queue(asked.store, BATCH, batch)
    asked.call("CreateSimulationJob", **request)
    assert is_queued(asked.store, BATCH, batch)
    advance(asked.store, BATCH, batch, "Completed")
    leave_queue(asked.store, BATCH, batch)
    asked.call("CreateSimulationJob", **request)
    assert not is_queued(asked.store, BATCH, batch)
