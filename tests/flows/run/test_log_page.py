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
from prefect import flow
from prefect.client.schemas.objects import FlowRun
from prefect.context import FlowRunContext
from prefect.logging.handlers import APILogHandler, set_api_log_sink

from flows.prefect.prefect_events import log_on_page
from specs.errors import DocumentError
from tasks.progress.log_lines import LOG_FORMAT, LOGGERS

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
