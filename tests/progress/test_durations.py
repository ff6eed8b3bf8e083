"""How long a step took is told to a program that reads the log, not to a person."""

import logging

import pytest

from tasks.progress.durations import log_duration
from tasks.progress.log_lines import LOG_FORMAT


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
