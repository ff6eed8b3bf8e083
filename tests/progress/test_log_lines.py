"""SIMYARD_LOG_FORMAT: what Simyard logs is one event a line, for a program to read."""

import json
import logging
import shlex

import pytest

from specs.errors import DocumentError
from tasks.progress.log_lines import LOG_FORMAT, log_in_chosen_format

LOGGER = logging.getLogger("tasks.simulate.somewhere")
FACTS = {"batch": "simb-1", "lanes": 256, "why": "two words", "text": 'a "quoted"\nline'}


def written(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], form: str) -> str:
    monkeypatch.setenv(LOG_FORMAT, form)
    with log_in_chosen_format():
        LOGGER.info("%d chunks", 3, extra={"fields": FACTS})
    return capsys.readouterr().err


def test_an_event_is_a_line_of_json(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    (line,) = written(monkeypatch, capsys, "json").splitlines()
    event = json.loads(line)
    assert event.pop("time").endswith("+00:00")
    assert event == {"level": "INFO", "logger": LOGGER.name, "event": "3 chunks", **FACTS}


def test_an_event_is_a_line_of_keys_and_values(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    (line,) = written(monkeypatch, capsys, "keyvalue").splitlines()
    pairs = dict(pair.split("=", 1) for pair in shlex.split(line))
    assert pairs["event"] == "3 chunks"
    assert (pairs["batch"], pairs["lanes"], pairs["why"]) == ("simb-1", "256", "two words")


def test_no_value_writes_to_the_terminal_of_who_reads(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv(LOG_FORMAT, "keyvalue")
    with log_in_chosen_format():
        LOGGER.info("\x1b[2J")
    assert 'event="\\u001b[2J"' in capsys.readouterr().err


def test_an_exception_is_part_of_its_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setenv(LOG_FORMAT, "json")
    with log_in_chosen_format():
        try:
            int("so")
        except ValueError:
            LOGGER.exception("that")
    (line,) = capsys.readouterr().err.splitlines()
    assert json.loads(line)["exception"].endswith("'so'")


def test_what_libraries_log_is_left_out(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setenv(LOG_FORMAT, "json")
    with log_in_chosen_format():
        logging.getLogger("httpx").info("GET")
    assert capsys.readouterr().err == ""


def test_a_line_is_written_once_where_blocks_are_nested(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv(LOG_FORMAT, "json")
    with log_in_chosen_format(), log_in_chosen_format():
        LOGGER.info("once")
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_without_the_setting_nothing_changes(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    assert written(monkeypatch, capsys, "") == ""


def test_afterwards_nothing_is_left(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    written(monkeypatch, capsys, "json")
    monkeypatch.setenv(LOG_FORMAT, "json")
    LOGGER.info("late")
    assert capsys.readouterr().err == ""


def test_another_format_is_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv(LOG_FORMAT, "xml")
    with pytest.raises(DocumentError, match="json or keyvalue"), log_in_chosen_format():
        pass
