"""A job that its controller left is closed so that the controller, should it wake up, asks nobody any more."""

from collections.abc import Callable

import pytest
from pydantic import JsonValue

from specs.errors import StoreError
from tasks.deploy.fleet.fleet_registry import NOTHING_ASKED, read_desired
from tasks.deploy.fleet.states import Desired
from tasks.deploy.rollout.controller import ask_robot
from tasks.deploy.rollout.operator_commands import close_abandoned_job
from tasks.storage.base.keys import claim_key, desired_key
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.jobs.records import JobRecord, advance, read, submit
from tests.deploy.one_robot import GOOD, desired
from tests.deploy.yard import Yard

KIND = "deployment-job"
_ANNOUNCED: dict[str, JsonValue] = {"status": "PendingNewDeployment", "started_at_s": 1.0}


def _announcing(yard: Yard) -> JobRecord:
    """Returns a job whose controller is about to ask robot r1."""
    record = submit(yard.store, KIND, {}, "left")
    return advance(yard.store, KIND, record.id, "InProgress", detail={"progress": {"r1": _ANNOUNCED}}, epoch=1)


def _closed(yard: Yard, record: JobRecord) -> JobRecord:
    for _ in range(2):  # the paused one had the first epoch
        with hold_claim(yard.store, claim_key(KIND, record.id)) as claim:
            pass
    with hold_claim(yard.store, claim_key(KIND, record.id)) as claim:
        return close_abandoned_job(yard.store, record, claim, "left")


def _wanted(yard: Yard, record: JobRecord) -> Desired:
    return desired(yard.publish(GOOD), 1, deployment=record.id)


def _wakes_up(yard: Yard, record: JobRecord) -> Callable[[], None]:
    """Returns a check of the claim that passes, and is followed by the pause in which the job is closed."""
    checks: list[int] = []

    def check() -> None:
        if checks:
            raise StoreError("the claim is another's")
        checks.append(1)
        _closed(yard, record)

    return check


def test_a_robot_that_was_never_asked_is_not_asked_by_who_wakes_up(yard: Yard) -> None:
    record = _announcing(yard)

    with pytest.raises(StoreError, match="another's"):
        ask_robot(yard.store, _wanted(yard, record), check=_wakes_up(yard, record))

    assert read_desired(yard.store, "r1")[0] is None
    assert read(yard.store, KIND, record.id).status == "Canceled"


def test_a_robot_keeps_what_another_deployment_asked_of_it(yard: Yard) -> None:
    record, before = _announcing(yard), ask_robot(yard.store, desired(yard.publish(GOOD), 1, deployment="dep-before"))

    with pytest.raises(StoreError, match="another's"):
        ask_robot(yard.store, _wanted(yard, record), check=_wakes_up(yard, record))

    assert read_desired(yard.store, "r1")[0] == before


def test_what_lies_there_and_is_too_big_asks_nothing_afterwards(yard: Yard) -> None:
    record = _announcing(yard)
    yard.store.put(desired_key("r1"), b" " * (1 << 21))

    with pytest.raises(StoreError, match="another's"):
        ask_robot(yard.store, _wanted(yard, record), check=_wakes_up(yard, record))

    assert yard.store.get(desired_key("r1")).body == NOTHING_ASKED


def test_a_robot_that_was_asked_stays_asked(yard: Yard) -> None:
    record = _announcing(yard)
    ask_robot(yard.store, _wanted(yard, record))
    before = yard.store.get(desired_key("r1"))

    assert _closed(yard, record).status == "Canceled"

    assert yard.store.get(desired_key("r1")) == before


def test_after_a_job_was_closed_a_robot_is_asked_as_ever(yard: Yard) -> None:
    record = _announcing(yard)
    _closed(yard, record)

    asked = ask_robot(yard.store, desired(yard.publish(GOOD), 1, deployment="dep-next"))

    assert read_desired(yard.store, "r1")[0] == asked


def test_who_was_killed_while_closing_leaves_a_job_that_the_next_one_closes(
    yard: Yard, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = _announcing(yard)

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("tasks.deploy.rollout.operator_commands.read_desired", killed)
        with pytest.raises(KeyboardInterrupt):
            _closed(yard, record)
    assert read(yard.store, KIND, record.id).status == "InProgress"

    with pytest.raises(StoreError, match="since epoch"):
        advance(yard.store, KIND, record.id, "InProgress", epoch=1)
    assert _closed(yard, record).status == "Canceled"
