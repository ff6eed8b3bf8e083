"""Logs for a program to read, and durations."""

import json
import logging
import shlex

import pytest

from specs.errors import DocumentError
from tasks.progress.log_lines import LOG_FORMAT, log_duration, log_in_chosen_format, taken_s

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


def told(caplog: pytest.LogCaptureFixture) -> list[logging.LogRecord]:
    with caplog.at_level(logging.INFO), log_duration("audit"):
        pass
    return caplog.records


def test_a_persons_log_says_nothing_of_it(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture):
    monkeypatch.delenv(LOG_FORMAT, raising=False)
    assert told(caplog) == []


def test_a_programs_log_names_the_step_and_its_seconds(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    monkeypatch.setenv(LOG_FORMAT, "json")
    (record,) = told(caplog)
    assert record.__dict__["fields"]["step"] == "audit"
    assert 0 <= record.__dict__["fields"]["seconds"] < 60


def test_what_steps_took_is_added_up_and_a_step_under_way_counts_at_its_end():
    with log_duration("here"):
        assert taken_s("here") == 0.0
    first_s = taken_s("here")
    assert first_s > 0.0
    with pytest.raises(ValueError, match="there"), log_duration("there"):
        raise ValueError("there")
    assert taken_s("here", "there") == first_s + taken_s("there") > first_s
    assert taken_s("nowhere") == 0.0
