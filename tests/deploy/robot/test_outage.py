import logging

import pytest

from tasks.deploy.robot import reported_state
from tasks.deploy.robot.reported_state import Outage


def test_an_outage_is_logged_when_it_begins_and_when_it_ends(caplog: pytest.LogCaptureFixture) -> None:
    away = Outage("report")
    for _ in range(1000):
        away.failed(TimeoutError("away"))
    away.worked()
    away.worked()

    assert [record.getMessage().split(" after ")[0] for record in caplog.records] == [
        "cannot report: away",
        "can report again",
    ]


def test_an_outage_that_turns_into_another_one_is_logged_again(caplog: pytest.LogCaptureFixture) -> None:
    away = Outage("report")
    for exc in (TimeoutError("away"), PermissionError("no"), PermissionError("no")):
        away.failed(exc)

    assert len(caplog.records) == 2


def test_a_long_outage_is_logged_now_and_then(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.set_level(logging.INFO)
    now_s = [0.0]
    monkeypatch.setattr(reported_state.time, "monotonic", lambda: now_s[0])
    away = Outage("report")
    for _ in range(3600):
        now_s[0] += 1.0
        away.failed(TimeoutError("away"))

    assert len(caplog.records) == 6
