"""A version that passed its launch and then does not stay up is left for the one before it."""

import time

import pytest

from tasks.deploy.fleet.fleet_registry import read_reported
from tasks.deploy.fleet.states import Reported
from tests.deploy.one_robot import GOOD, NAME, OneRobot
from tests.deploy.yard import eventually

# Stays up for longer than the grace period of a launch, the first time.
CRASHES = """#!/bin/sh
echo crashing >> "$HOME/crashes"
if [ -e "$HOME/started-once" ]; then exit 7; fi
touch "$HOME/started-once"
sleep 0.5
exit 7
"""


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tasks.deploy.robot.launch._FIRST_PAUSE_S", 0.001)


def supervised(one: OneRobot, status: str) -> Reported:
    def look() -> bool:
        one.robot.supervise()
        time.sleep(0.002)
        reported = read_reported(one.yard.store, NAME)
        return reported is not None and reported.status == status

    eventually(look)
    found = read_reported(one.yard.store, NAME)
    assert found
    return found


def test_a_crash_loop_goes_back_and_is_told(one: OneRobot) -> None:
    good, bad = one.yard.publish(GOOD), one.yard.publish({"run.sh": CRASHES})
    one.deploy(good, 1)
    assert one.deploy(bad, 2).status == "InSync"

    told = supervised(one, "Failed")

    assert (told.deployment, told.failure_code, told.running_digest) == ("dep-2", "EnvironmentSetupError", good.digest)
    assert told.failure_reason.startswith(
        "the application ended 5 times, each soon after its start; run.sh exited with 7"
    )
    assert told.failure_reason.endswith(f"went back to version {good.number}")
    assert one.yard.current(NAME) == good.digest
    assert [program for program in one.programs if "sleep 1000" in program]


def test_after_a_restart_it_still_runs_what_it_went_back_to(one: OneRobot) -> None:
    good, bad = one.yard.publish(GOOD), one.yard.publish({"run.sh": CRASHES})
    one.deploy(good, 1)
    one.deploy(bad, 2)
    supervised(one, "Failed")
    one.robot.end()
    one.restarted().recover()
    assert one.yard.current(NAME) == good.digest
    reported = read_reported(one.yard.store, NAME)
    assert reported
    assert reported.status == "Failed"


def test_the_only_version_there_is_is_tried_for_ever(one: OneRobot) -> None:
    bad = one.yard.publish({"run.sh": CRASHES})
    one.deploy(bad, 1)

    def often() -> bool:
        one.robot.supervise()
        return len((one.root / "crashes").read_text().splitlines()) > 7

    eventually(often)
    assert one.yard.current(NAME) == bad.digest
