"""How long a step took is told to a program that reads the log, not to a person."""

import logging

import pytest

from tasks.progress.log_lines import LOG_FORMAT, log_duration, taken_s


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
