"""A change of a job's status is told when it is in the store, by the process that made it, and once."""

import logging

import pytest

from specs.job_kinds import JobKind
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import Transition, advance, listen_to_transitions, read, submit

KIND = "world-export-job"


@pytest.fixture
def job(store: Store) -> str:
    return submit(store, KIND, {}, "one").id


def test_each_change_of_status_is_told_once_and_nothing_else(store: Store, job: str):
    heard: list[Transition] = []
    with listen_to_transitions(heard.append):
        advance(store, KIND, job, "Running")
        advance(store, KIND, job, "Running", detail={"worlds": 3})
        advance(store, KIND, job, "Failed", failure_code="InvalidInput", failure_reason="no worlds")
        advance(store, KIND, job, "Completed")
    record = read(store, KIND, job)
    assert heard == [
        Transition(KIND, record.arn, "Pending", "Running", "", ""),
        Transition(KIND, record.arn, "Running", "Failed", "InvalidInput", "no worlds"),
    ]


def test_what_is_told_is_in_the_store_already(store: Store, job: str):
    found: list[str] = []
    with listen_to_transitions(lambda _change: found.append(read(store, KIND, job).status)):
        advance(store, KIND, job, "Running")
    assert found == ["Running"]


def test_a_change_that_is_not_made_is_not_told(store: Store, job: str):
    heard: list[Transition] = []
    with listen_to_transitions(heard.append):
        advance(store, KIND, job, "Completed", only_from={"Running"})
    assert heard == []


def test_nobody_hears_outside_the_block(store: Store, job: str):
    heard: list[Transition] = []
    with listen_to_transitions(heard.append):
        pass
    advance(store, KIND, job, "Running")
    assert heard == []


def test_a_change_is_logged_with_its_facts(file_store: Store, caplog: pytest.LogCaptureFixture):
    record = submit(file_store, KIND, {}, "one")
    with caplog.at_level(logging.INFO, logger="tasks.storage.jobs.records"):
        advance(file_store, KIND, record.id, "Running")
    (line,) = caplog.records
    assert line.getMessage() == f"{record.arn} is Running"
    assert line.__dict__["fields"] == {"kind": KIND, "arn": record.arn, "was": "Pending", "status": "Running"}


def test_a_failure_is_logged_with_its_code_and_reason(file_store: Store, caplog: pytest.LogCaptureFixture):
    record = submit(file_store, KIND, {}, "one")
    with caplog.at_level(logging.INFO, logger="tasks.storage.jobs.records"):
        advance(file_store, KIND, record.id, "Failed", failure_code="InvalidInput", failure_reason="no worlds")
    assert caplog.messages == [f"{record.arn} is Failed: InvalidInput: no worlds"]


@pytest.mark.parametrize(("kind", "flow"), [("pipeline-run", "world-generation"), (KIND, "")])
def test_a_change_of_a_run_names_its_flow(file_store: Store, kind: JobKind, flow: str):
    record = submit(file_store, kind, {"flow": flow or "any"}, "one")
    heard: list[Transition] = []
    with listen_to_transitions(heard.append):
        advance(file_store, kind, record.id, "Running")
    assert [each.flow for each in heard] == [flow]
