"""What Simyard logs in a flow run is sent to its page: which lines, from which threads, and nothing afterwards."""

import logging
import threading
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from contextvars import copy_context
from typing import Any
from uuid import UUID, uuid4

import pytest
from hypothesis import given
from hypothesis import strategies as st
from prefect import flow
from prefect.assets import Asset as PrefectAsset
from prefect.client.schemas.objects import FlowRun
from prefect.context import FlowRunContext
from prefect.logging.handlers import APILogHandler, set_api_log_sink

from flows.pipeline.run_gate import GateAnswer
from flows.pipeline.stage_report import Asset, MadeAsset
from flows.prefect import prefect_events
from flows.prefect.prefect_events import (
    MATERIALIZED,
    REFERENCED,
    announce_alarm,
    announce_asset,
    announce_changes,
    announce_verdict,
    asset_key,
    event_id,
    log_on_page,
)
from specs.errors import DocumentError
from tasks.progress.log_lines import LOG_FORMAT, LOGGERS
from tasks.results.trend.trend_view import Alarm
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, read, submit

LOGGER = logging.getLogger("tasks.simulate.somewhere")
RUN = UUID(int=1)
assert flow  # its import sets up Prefect's logging, as that of every flow does
Lines = list[dict[str, Any]]


@pytest.fixture
def lines() -> Generator[Lines]:
    """Yields what is sent to pages, instead of sending it."""
    found: Lines = []
    set_api_log_sink(found.append)
    yield found
    set_api_log_sink(None)


@contextmanager
def flow_run() -> Generator[None]:
    """As inside a flow run, as far as its log knows."""
    with FlowRunContext.model_construct(flow_run=FlowRun(id=RUN, flow_id=uuid4())):
        yield


def messages(lines: Lines) -> list[str]:
    return [line["message"] for line in lines]


@pytest.mark.parametrize("name", [f"{package}.some.module" for package in LOGGERS])
def test_a_line_of_any_of_our_packages_is_on_the_page_of_its_flow_run(lines: Lines, name: str):
    with flow_run(), log_on_page():
        logging.getLogger(name).info("%d worlds", 2)
    assert [(line["message"], line["flow_run_id"], line["level"]) for line in lines] == [
        ("2 worlds", str(RUN), logging.INFO)
    ]


def test_what_tells_no_story_is_not_there(lines: Lines):
    with flow_run(), log_on_page():
        LOGGER.debug("a detail")
    assert lines == []


def test_a_line_is_there_once_where_blocks_are_nested(lines: Lines):
    with flow_run(), log_on_page(), log_on_page():
        LOGGER.info("once")
    assert messages(lines) == ["once"]


def test_the_end_of_an_inner_block_ends_nothing(lines: Lines):
    with flow_run(), log_on_page():
        with log_on_page():
            pass
        LOGGER.info("still")
    assert messages(lines) == ["still"]


def test_a_line_of_a_thread_that_has_the_runs_context_is_there(lines: Lines):
    with flow_run(), log_on_page():
        thread = threading.Thread(target=copy_context().run, args=(LOGGER.warning, "from a thread"))
        thread.start()
        thread.join()
    assert messages(lines) == ["from a thread"]


def test_a_line_outside_of_any_run_is_dropped_without_a_warning(lines: Lines):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with log_on_page():
            LOGGER.warning("nobody's")
    assert lines == []


def test_afterwards_nothing_is_left(lines: Lines):
    before = [(logging.getLogger(name).level, list(logging.getLogger(name).handlers)) for name in LOGGERS]
    with log_on_page():
        pass
    after = [(logging.getLogger(name).level, list(logging.getLogger(name).handlers)) for name in LOGGERS]
    assert after == before
    with flow_run():
        LOGGER.warning("late")
    assert lines == []


def test_a_format_that_there_is_not_leaves_no_handler_behind(lines: Lines, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(LOG_FORMAT, "runes")
    with pytest.raises(DocumentError), log_on_page():
        pass
    monkeypatch.delenv(LOG_FORMAT)
    with log_on_page():
        pass
    assert not any(isinstance(each, APILogHandler) for each in logging.getLogger("tasks").handlers)


def test_a_handler_that_the_user_chose_is_not_doubled(lines: Lines):
    chosen, logger = APILogHandler(), logging.getLogger("tasks")
    logger.addHandler(chosen)
    try:
        with flow_run(), log_on_page():
            LOGGER.info("once")
        assert chosen in logger.handlers
    finally:
        logger.removeHandler(chosen)
    assert messages(lines) == ["once"]


def test_a_level_that_the_user_chose_stays(lines: Lines):
    logger = logging.getLogger("tasks")
    logger.setLevel(logging.WARNING)
    try:
        with flow_run(), log_on_page():
            LOGGER.info("more than asked for")
            LOGGER.warning("asked for")
    finally:
        logger.setLevel(logging.NOTSET)
    assert messages(lines) == ["asked for"]


def test_with_a_format_for_programs_prefects_console_does_not_say_it_again(monkeypatch: pytest.MonkeyPatch):
    said: list[str] = []
    monkeypatch.setattr("prefect.logging.handlers.PrefectConsoleHandler.emit", lambda _, line: said.append(line.msg))
    monkeypatch.setenv(LOG_FORMAT, "json")
    with log_on_page():
        LOGGER.info("an event")
        logging.getLogger("prefect").info("a line of Prefect's")
    assert said == ["a line of Prefect's"]


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


WORLDS, COURIER = Asset("s3://b/p/worlds/wgj-1", "worlds of wgj-1"), Asset("s3://b/p/bundles/f9", "courier 1")
TABLES = MadeAsset(Asset("s3://b/p/simb-1/results.parquet", "results of simb-1"), (WORLDS, COURIER), {"episodes": 8})


def test_what_was_made_names_its_sources_and_its_figures(sent: Sent):
    announce_asset(TABLES)
    event, resource, more = sent[-1]
    assert event == MATERIALIZED
    assert resource == {"prefect.resource.id": TABLES.asset.url, "prefect.resource.name": "results of simb-1"}
    assert [each["prefect.resource.id"] for each in more["related"]] == [WORLDS.url, COURIER.url, "simyard"]
    assert more["payload"] == {"episodes": 8}


def test_each_source_is_referenced(sent: Sent):
    announce_asset(TABLES)
    assert [(event, each["prefect.resource.name"]) for event, each, _ in sent[:-1]] == [
        (REFERENCED, "worlds of wgj-1"),
        (REFERENCED, "courier 1"),
    ]


def test_the_same_asset_has_the_same_ids_however_often_it_is_told(sent: Sent):
    announce_asset(TABLES)
    announce_asset(TABLES)
    ids = [more["id"] for _, _, more in sent]
    assert ids[:3] == ids[3:]
    assert len(set(ids)) == 3


def test_what_was_made_anew_with_other_figures_is_told_again(sent: Sent):
    announce_asset(TABLES)
    announce_asset(TABLES._replace(facts={"episodes": 9}))
    told = [more["id"] for event, _, more in sent if event == MATERIALIZED]
    assert len(set(told)) == 2


def test_a_source_of_two_things_is_referenced_by_both(sent: Sent):
    announce_asset(TABLES)
    announce_asset(TABLES._replace(asset=Asset("s3://b/p/other", "other")))
    assert len({more["id"] for _, _, more in sent}) == len(sent)


def test_an_event_of_an_asset_that_cannot_be_sent_harms_no_job(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    def refuse(*_: object, **__: object) -> None:
        raise RuntimeError("no route")

    monkeypatch.setattr(prefect_events, "emit_event", refuse)
    with caplog.at_level(logging.WARNING, logger="flows.prefect.prefect_events"):
        announce_asset(TABLES)
    assert "results of simb-1 was made: no route" in caplog.text


def test_a_key_is_the_url_where_prefect_takes_it():
    assert asset_key("s3://bucket/a/results.parquet") == "s3://bucket/a/results.parquet"


def test_a_key_has_no_secret():
    key = asset_key("s3://me:secret@bucket/a?token=secret#secret")
    assert key.startswith("s3://bucket/a-")
    assert "secret" not in key
    assert "me" not in key


URLS = st.text(max_size=600).map(lambda text: f"file:///{text}") | st.text("a %&_", max_size=8).map("file:///{}".format)


@given(URLS)
def test_prefect_takes_every_key(url: str):
    assert PrefectAsset(key=asset_key(url)).key.startswith("file:///")


@given(URLS, URLS)
def test_two_paths_never_have_the_same_key(url: str, other: str):
    assert (asset_key(url) == asset_key(other)) == (_plain(url) == _plain(other))


def _plain(url: str) -> str:
    return url.partition("#")[0].partition("?")[0]
