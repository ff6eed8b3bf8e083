"""Events of job transitions and verdicts: their names, ids and facts; and that they never harm a job."""

import logging
from typing import Any

import pytest

from flows.pipeline.run_gate import GateAnswer
from flows.prefect import prefect_events
from flows.prefect.prefect_events import announce_alarm, announce_changes, announce_verdict, event_id
from tasks.results.trend.trend_view import Alarm
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, read, submit

Sent = list[tuple[str, dict[str, str], dict[str, Any]]]


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> Sent:
    """Returns what is sent, instead of sending it."""
    found: Sent = []
    monkeypatch.setattr(
        prefect_events, "emit_event", lambda event, resource, **more: found.append((event, resource, more))
    )
    return found


def batch_of(store: Store) -> JobRecord:
    return submit(store, "simulation-job-batch", {}, "one")


def test_a_change_of_status_is_an_event_about_the_jobs_arn(file_store: Store, sent: Sent):
    batch = batch_of(file_store)
    with announce_changes():
        advance(
            file_store, batch.kind, batch.id, "Failed", failure_code="InternalServiceError", failure_reason="no worlds"
        )
    ((event, resource, more),) = sent
    assert event == "simyard.simulation-batch.Failed"
    assert resource == {"prefect.resource.id": batch.arn, "prefect.resource.name": batch.id}
    assert more["payload"] == {
        "was": "Pending",
        "failureCode": "InternalServiceError",
        "failureReason": "no worlds",
    }


def test_the_run_of_a_document_is_an_event_and_the_run_of_a_stage_alone_is_none(file_store: Store, sent: Sent):
    whole = submit(file_store, "pipeline-run", {"flow": "pipeline"}, "one")
    alone = submit(file_store, "pipeline-run", {"flow": "world-generation"}, "two")
    with announce_changes():
        for run in (whole, alone):
            advance(file_store, run.kind, run.id, "Running")
    assert [(event, resource["prefect.resource.id"]) for event, resource, _ in sent] == [
        ("simyard.pipeline.Running", whole.arn)
    ]


def test_outside_of_a_flow_nothing_is_sent(file_store: Store, sent: Sent):
    batch = batch_of(file_store)
    advance(file_store, batch.kind, batch.id, "InProgress")
    assert sent == []


def test_a_verdict_is_an_event_about_its_run(file_store: Store, sent: Sent):
    batch, run = batch_of(file_store), submit(file_store, "pipeline-run", {}, "one")
    answer = GateAnswer(batch=batch.id, verdict="FAIL", sentence="2 of 8", evidence_url="file:///e", evidence="0" * 64)
    announce_verdict(answer, run, batch)
    ((event, resource, more),) = sent
    assert (event, resource["prefect.resource.id"]) == ("simyard.gate.FAIL", run.arn)
    assert more["payload"] == {"sentence": "2 of 8", "evidence": "file:///e", "batch": batch.arn}


def test_the_same_change_has_the_same_id_wherever_it_is_told():
    one = event_id("simyard.pipeline.Failed", "arn:simyard:pipeline-run:s:run-1")
    assert one == event_id("simyard.pipeline.Failed", "arn:simyard:pipeline-run:s:run-1")
    assert one != event_id("simyard.pipeline.Completed", "arn:simyard:pipeline-run:s:run-1")
    assert one != event_id("simyard.pipeline.Failed", "arn:simyard:pipeline-run:s:run-2")


def test_an_event_that_cannot_be_sent_harms_no_job(
    file_store: Store, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    def refuse(*_: object, **__: object) -> None:
        raise RuntimeError("no route")

    monkeypatch.setattr(prefect_events, "emit_event", refuse)
    batch = batch_of(file_store)
    with caplog.at_level(logging.WARNING, logger="flows.prefect.prefect_events"), announce_changes():
        advance(file_store, batch.kind, batch.id, "InProgress")
    assert read(file_store, batch.kind, batch.id).status == "InProgress"
    assert "no route" in caplog.text


def test_alarms_of_two_series_of_one_batch_are_two_events_and_the_same_alarm_is_one(sent: Sent):
    facts = {"fell": True, "sentence": "s", "before": 0.9, "after": 0.8, "began": "b", "began_on": "", "bundle": "d"}
    rest = {"bundle_name": "", "new_bundle": True, "earliest": "", "latest": "", "seen_on": "", "run": ""}
    seen = "arn:simyard:simulation-job-batch:0123456789ab:simb-1"
    alarms = [Alarm.model_validate({**facts, **rest, "seen": seen, "series": name}) for name in ("all", "w1", "all")]
    for alarm in alarms:
        announce_alarm(alarm, "file:///trend.html")
    assert {event for event, _, _ in sent} == {"simyard.trend.Fell"}
    first, second, again = (more["id"] for _, _, more in sent)
    assert first == again != second
    assert sent[1][2]["payload"] == {
        "sentence": "s", "series": "w1", "began": "b", "bundle": "d", "page": "file:///trend.html",
    }  # fmt: skip
