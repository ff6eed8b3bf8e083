"""Reports of a robot, while the store is there and while it is away."""

import logging
from typing import cast

import pytest

from tasks.deploy.fleet.fleet_registry import read_reported
from tasks.deploy.robot import reported_state
from tasks.deploy.robot.reported_state import Attempt, Outage, Reporter
from tasks.storage.base.store import Store
from tests.deploy.one_robot import NAME, desired
from tests.deploy.puppets import FailingStore
from tests.deploy.yard import STAYS_UP, Yard


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


def _attempt(yard: Yard, reporter: Reporter) -> Attempt:
    return Attempt(reporter, desired(yard.publish({"run.sh": STAYS_UP}), 1), "boot", "")


def test_what_could_not_be_told_is_told_when_the_store_is_back(yard: Yard) -> None:
    reporter = Reporter(cast("Store", FailingStore(yard.store, 1, after=False)), NAME)
    _attempt(yard, reporter).at("Launching")
    assert read_reported(yard.store, NAME) is None

    assert reporter.flush()

    reported = read_reported(yard.store, NAME)
    assert reported is not None
    assert reported.step == "Launching"


def test_the_percentage_is_told_but_not_every_time(yard: Yard) -> None:
    reporter = Reporter(yard.store, NAME)
    attempt = _attempt(yard, reporter)
    attempt.percent(1.0)
    for percent in range(2, 100):
        attempt.percent(float(percent))

    reported = read_reported(yard.store, NAME)
    assert reported is not None
    assert reported.percent_done < 99.0


def test_an_attempt_ends_at_the_step_where_it_failed(yard: Yard) -> None:
    attempt = _attempt(yard, Reporter(yard.store, NAME))
    attempt.at("ExecutingPreLaunch")

    failed = attempt.failed("PreLaunchFileFailure", "x" * 5000)

    assert (failed.status, failed.step, len(failed.failure_reason)) == ("Failed", "ExecutingPreLaunch", 1024)
    assert failed.finished_at_s >= failed.started_at_s


def test_the_log_says_when_each_step_began_and_ended(yard: Yard, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, logger="tasks.deploy.robot.reported_state")
    attempt = _attempt(yard, Reporter(yard.store, NAME))
    for step in ("Validating", "Launching"):
        attempt.at(step)
    attempt.failed("EnvironmentSetupError", "it ended")

    told = [record.getMessage().split(": ")[1].split(" after")[0] for record in caplog.records]
    assert told == ["Validating begins", "Validating is done", "Launching begins", "Launching failed"]
