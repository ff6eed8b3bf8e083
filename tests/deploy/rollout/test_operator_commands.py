"""Pause, resume, cancel; and the end of a deployment that was abandoned."""

from collections.abc import Callable

import pytest
from pydantic import JsonValue

from specs.errors import DocumentError, StageFailed, StoreError
from specs.job_kinds import JobKind
from tasks.deploy.fleet.fleet_registry import NOTHING_ASKED, read_desired, read_fleet
from tasks.deploy.fleet.states import Desired
from tasks.deploy.rollout import operator_commands
from tasks.deploy.rollout.controller import ask_robot, withdraw_request, withdrawn_sequence
from tasks.deploy.rollout.observation import recorded_progress
from tasks.deploy.rollout.operator_commands import active_deployment, close_abandoned_job, steer
from tasks.storage.base.keys import claim_key, desired_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim
from tasks.storage.jobs.records import JobRecord, advance, read, submit
from tests.deploy.one_robot import GOOD, desired
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard

pytestmark = pytest.mark.usefixtures("quick_claims")
KIND = "deployment-job"
_ANNOUNCED: dict[str, JsonValue] = {"status": "PendingNewDeployment", "started_at_s": 1.0}


def job_of(yard: Yard) -> str:
    return read_fleet(yard.store, FLEET).deployment


def test_a_canceled_deployment_asks_nobody_further_and_those_asked_finish(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 5), yard.publish({"run.sh": STAYS_UP})

    def cancel_at_the_first(ended: int, _robots: int) -> None:
        if ended == 2:
            steer(yard.store, job_of(yard), "cancel")

    record = run(yard, robots, yard.request(version, "one"), version.digest, cancel_at_the_first)

    assert record.status == "Canceled"
    statuses = [progress.failure_code for progress in recorded_progress(record).values()]
    assert statuses.count("RobotDeploymentAborted") == 5 - len(robots.asked())
    assert 2 <= len(robots.asked()) <= 4
    assert {robot.status for robot in recorded_progress(record).values() if not robot.failure_code} == {"InSync"}


def test_a_deployment_that_nobody_works_on_is_canceled_at_once(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 5), yard.publish({"run.sh": STAYS_UP})
    robots.dies_after = 1
    with pytest.raises(StageFailed):
        run(yard, robots, yard.request(version, "one"), version.digest)

    assert steer(yard.store, job_of(yard), "cancel").status == "Canceled"
    assert run(yard, robots, yard.request(version, "one"), version.digest).status == "Canceled"
    assert run(yard, robots, yard.request(version, "two"), version.digest).status == "Succeeded"


def test_a_paused_deployment_waits_and_goes_on_where_it_was(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 5), yard.publish({"run.sh": STAYS_UP})
    waited: list[int] = []
    sleep = robots.pace.sleep

    def look(seconds: float) -> None:
        sleep(seconds)
        waited.append(len(robots.asked()))
        if len(waited) == 1:
            steer(yard.store, job_of(yard), "pause")
        if len(waited) == 12:
            steer(yard.store, job_of(yard), "go")

    robots.pace_sleep = look
    record = run(yard, robots, yard.request(version, "one"), version.digest)

    assert record.status == "Succeeded"
    assert set(waited[2:12]) == {waited[1]}
    assert waited[1] < 5


def test_one_that_takes_over_knows_that_the_deployment_is_paused(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 5), yard.publish({"run.sh": STAYS_UP})
    robots.dies_after = 0
    with pytest.raises(StageFailed):
        run(yard, robots, yard.request(version, "one"), version.digest)
    steer(yard.store, job_of(yard), "pause")
    asked = len(robots.asked())
    robots.dies_after = 6
    with pytest.raises(StageFailed):
        run(yard, robots, yard.request(version, "one"), version.digest)
    assert len(robots.asked()) == asked
    assert read(yard.store, KIND, job_of(yard)).status == "InProgress"


def test_an_ended_deployment_is_not_steered(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 1), yard.publish({"run.sh": STAYS_UP})
    record = run(yard, robots, yard.request(version, "one"), version.digest)
    with pytest.raises(DocumentError, match="Succeeded"):
        steer(yard.store, record.id, "cancel")
    assert not active_deployment(yard.store, FLEET)


def test_what_is_being_canceled_does_not_go_on(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 5), yard.publish({"run.sh": STAYS_UP})

    def steer_twice(ended: int, _robots: int) -> None:
        if ended == 2:
            steer(yard.store, job_of(yard), "cancel")
            with pytest.raises(DocumentError, match="being canceled"):
                steer(yard.store, job_of(yard), "go")

    assert run(yard, robots, yard.request(version, "one"), version.digest, steer_twice).status == "Canceled"


def test_who_resumes_at_the_same_moment_takes_no_cancellation_back(yard: Yard, monkeypatch: pytest.MonkeyPatch) -> None:
    robots, version = PuppetRobots(yard.store, 5), yard.publish({"run.sh": STAYS_UP})
    read_record = operator_commands.read

    def cancel_after_the_look(store: Store, kind: JobKind, job: str) -> JobRecord:
        found = read_record(store, kind, job)
        monkeypatch.undo()
        steer(store, job, "cancel")
        return found

    def resume(ended: int, _robots: int) -> None:
        if ended == 2:
            steer(yard.store, job_of(yard), "pause")
            monkeypatch.setattr(operator_commands, "read", cancel_after_the_look)
            steer(yard.store, job_of(yard), "go")

    assert run(yard, robots, yard.request(version, "one"), version.digest, resume).status == "Canceled"


def test_a_fleet_whose_time_is_over_fails_with_a_code_of_its_own(yard: Yard, monkeypatch: pytest.MonkeyPatch) -> None:
    robots, version = PuppetRobots(yard.store, 5, step_s=31 * 86_400.0), yard.publish({"run.sh": STAYS_UP})
    record = run(yard, robots, yard.request(version, "one"), version.digest)
    assert (record.status, record.failure_code) == ("Failed", "FleetDeploymentTimeout")
    assert "; the fleet's time was over" in record.failure_reason


def test_what_is_not_paused_is_not_resumed(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 3), yard.publish({"run.sh": STAYS_UP})

    def resume(ended: int, _robots: int) -> None:
        if ended == 1:
            with pytest.raises(DocumentError, match="paused"):
                steer(yard.store, job_of(yard), "go")

    assert run(yard, robots, yard.request(version, "one"), version.digest, resume).status == "Succeeded"


def test_a_cancellation_takes_back_what_a_silent_robot_was_asked(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 3), yard.publish({"run.sh": STAYS_UP})
    robots.silent = {"r2"}

    def cancel_at_the_second(ended: int, _robots: int) -> None:
        if ended == 2:
            steer(yard.store, job_of(yard), "cancel")

    record = run(yard, robots, yard.request(version, "one"), version.digest, cancel_at_the_second)

    assert record.status == "Canceled"
    silent = recorded_progress(record)["r2"]
    assert (silent.failure_code, "before this robot answered" in silent.failure_reason) == (
        "RobotDeploymentAborted",
        True,
    )
    assert [desired.robot for desired in robots.asked()] == ["r0", "r1"]


def test_who_was_taken_back_from_takes_the_next_deployment(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 3), yard.publish({"run.sh": STAYS_UP})
    robots.silent = {"r2"}

    def cancel_at_the_second(ended: int, _robots: int) -> None:
        if ended == 2:
            steer(yard.store, job_of(yard), "cancel")

    run(yard, robots, yard.request(version, "one"), version.digest, cancel_at_the_second)
    taken_back = withdrawn_sequence(yard.store, "r2")
    robots.silent = set()
    assert run(yard, robots, yard.request(version, "two"), version.digest).status == "Succeeded"
    desired = read_desired(yard.store, "r2")[0]

    assert desired is not None
    assert desired.sequence > taken_back > 0


def test_a_robot_that_answers_at_the_last_moment_stays_asked(yard: Yard) -> None:
    robots, version = PuppetRobots(yard.store, 3), yard.publish({"run.sh": STAYS_UP})
    run(yard, robots, yard.request(version, "one"), version.digest)

    assert not withdraw_request(yard.store, "r0", job_of(yard))
    assert read_desired(yard.store, "r0")[0] is not None
    assert withdraw_request(yard.store, "r0", "another")
    assert read_desired(yard.store, "r0")[0] is not None


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
