"""The controller: what it asks of robots, when it waits, stops, and is continued."""

import contextlib
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import cast

import pytest

from specs.errors import StageFailed, StoreUnreachable
from specs.pipeline.simulation_section import RollOutRules
from specs.robomaker.deployment import DeploymentConfig
from tasks.deploy.fleet.fleet_registry import create_robot, read_desired, register_robot
from tasks.deploy.fleet.states import MOST_SEQUENCE, Desired, Withdrawn
from tasks.deploy.fleet_descriptions import describe_deployment_job
from tasks.deploy.rollout.controller import ControllerPace, ask_robot
from tasks.deploy.rollout.observation import recorded_progress
from tasks.storage.base.keys import desired_key, reported_key
from tasks.storage.base.store import Store, encode_document
from tasks.storage.jobs.records import job_id, records
from tests.deploy.one_robot import GOOD, NAME, desired
from tests.deploy.puppets import CountingStore, FailingStore, PuppetRobots, run
from tests.deploy.trust.signed_fleet import Owner
from tests.deploy.yard import FLEET, STAYS_UP, Yard

NOW_S = 1_700_000_000.0
KIND = "deployment-job"


def _ask(yard: Yard, owner: Owner, deployment: str, now_s: float = NOW_S) -> Desired:
    wanted = desired(yard.publish(GOOD), 1, deployment=deployment, issued_at_s=now_s)
    return ask_robot(yard.store, wanted, owner.signer.sign, own=owner.signer.is_own)


def test_the_sequence_is_the_time_in_milliseconds(yard: Yard, owner: Owner) -> None:
    assert _ask(yard, owner, "one").sequence == NOW_S * 1000


def test_a_clock_that_was_set_back_still_gives_a_higher_sequence(yard: Yard, owner: Owner) -> None:
    first = _ask(yard, owner, "one")

    assert _ask(yard, owner, "two", NOW_S - 86_400).sequence == first.sequence + 1


def test_a_clock_that_goes_on_gives_a_higher_sequence_though_the_last_state_was_deleted(
    yard: Yard, owner: Owner
) -> None:
    first = _ask(yard, owner, "one")
    yard.store.delete(desired_key(NAME))

    assert _ask(yard, owner, "two", NOW_S + 1).sequence > first.sequence


@pytest.mark.parametrize("sequence", [5, 1 << 52, MOST_SEQUENCE])
@pytest.mark.parametrize("deployment", ["forged", "two"])
def test_a_state_that_the_owner_did_not_sign_is_written_over_and_its_numbers_do_not_count(
    sequence: int, deployment: str, yard: Yard, owner: Owner
) -> None:
    first = _ask(yard, owner, "one")
    forged = first.model_copy(update={"sequence": sequence, "deployment": deployment, "epoch": 1 << 30})
    yard.store.put(desired_key(NAME), encode_document(forged))

    second = _ask(yard, owner, "two", NOW_S + 1)

    assert second.sequence == (NOW_S + 1) * 1000
    assert read_desired(yard.store, NAME)[0] == second


def test_what_another_robot_was_asked_does_not_count(yard: Yard, owner: Owner) -> None:
    wanted = desired(yard.publish(GOOD), 1, robot="r2", deployment="one", issued_at_s=NOW_S)
    other = ask_robot(yard.store, wanted, owner.signer.sign, own=owner.signer.is_own)
    yard.store.put(desired_key(NAME), encode_document(other))

    assert _ask(yard, owner, "one").robot == NAME


@pytest.mark.parametrize("body", [b'{"sequence": 9007199254740992}', b'{"sequence": %s}' % (b"9" * 4300)])
def test_a_report_does_not_count(body: bytes, yard: Yard, owner: Owner) -> None:
    yard.store.put(reported_key(NAME), body)

    assert _ask(yard, owner, "one").sequence == NOW_S * 1000


def test_a_withdrawal_that_nobody_signed_does_not_count_where_things_are_signed(yard: Yard, owner: Owner) -> None:
    yard.store.put(desired_key(NAME), encode_document(Withdrawn(withdrawn=1 << 52)))

    assert _ask(yard, owner, "one").sequence == NOW_S * 1000


@pytest.mark.parametrize("sequence", [MOST_SEQUENCE - 1, MOST_SEQUENCE])
def test_a_fleet_without_keys_is_asked_too_when_somebody_has_used_up_the_numbers(sequence: int, yard: Yard) -> None:
    wanted = desired(yard.publish(GOOD), 1, deployment="two", issued_at_s=NOW_S)
    forged = wanted.model_copy(update={"sequence": sequence, "deployment": "forged"})
    yard.store.put(desired_key(NAME), encode_document(forged))

    assert ask_robot(yard.store, wanted).sequence in {MOST_SEQUENCE, NOW_S * 1000}


def test_a_robot_that_never_answers_counts_as_failed_after_its_timeout(yard: Yard) -> None:
    robots = PuppetRobots(yard.store, 5, step_s=10_000.0)
    robots.silent = {"r1"}
    version = yard.publish({"run.sh": STAYS_UP})

    record = run(yard, robots, yard.request(version, "one"), version.digest)

    assert record.status == "Succeeded"
    silent = recorded_progress(record)["r1"]
    assert (silent.status, silent.failure_code) == ("NoResponse", "RobotDeploymentNoResponse")


def test_a_silent_fleet_stops_the_roll_out(yard: Yard) -> None:
    robots = PuppetRobots(yard.store, 5, step_s=10_000.0)
    robots.silent = set(robots.names)
    version = yard.publish({"run.sh": STAYS_UP})

    record = run(yard, robots, yard.request(version, "one"), version.digest)

    assert (record.status, record.failure_code) == ("Failed", "FailureThresholdBreached")
    assert len(robots.asked()) == 2


def test_who_waits_for_a_silent_robot_learns_soon_and_once_who_may_write_where_it_reports(
    yard: Yard, caplog: pytest.LogCaptureFixture
) -> None:
    robots = PuppetRobots(yard.store, 3, step_s=10_000.0)
    robots.silent = {"r1"}
    version = yard.publish({"run.sh": STAYS_UP})
    folder = Path(yard.store.url.removeprefix("file://")) / "robots" / "r1"
    folder.chmod(0o755)

    run(yard, robots, yard.request(version, "one"), version.digest)

    (told,) = [each for each in caplog.messages if each.startswith("no answer for")]
    assert "25 s from 1 robots (r1): start its agent, or see in its log why; only " in told
    assert f"may write in {folder}" in told


@pytest.mark.parametrize("after", [False, True])
def test_a_controller_that_fails_at_any_request_is_continued_and_nobody_is_asked_twice(
    after: bool,  # noqa: FBT001 - a parameter of the test
    yard: Yard,
) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 3)
    nth = 0
    failing = FailingStore(yard.store, 0, after=after)
    while failing.left <= 0:  # until a whole deployment makes fewer requests
        nth += 1
        failing = FailingStore(yard.store, nth, after=after)
        request = yard.request(version, f"run-{nth}")
        with contextlib.suppress(StoreUnreachable):
            run(replace(yard, store=cast("Store", failing)), robots, request, version.digest)
        half = robots.asked()
        record = run(yard, robots, request, version.digest)

        assert (record.status, len(recorded_progress(record))) == ("Succeeded", 3)
        assert {desired.deployment for desired in robots.asked()} == {record.id}
        assert [each for each in half if each.deployment == record.id and each not in robots.asked()] == []

    assert nth > 30, "every request of a whole deployment was tried"
    assert len(records(yard.store, KIND)) == nth


def test_a_robot_that_has_ended_is_not_asked_about_again(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 8)
    counting = CountingStore(yard.store)

    run(replace(yard, store=cast("Store", counting)), robots, yard.request(version, "one"), version.digest)

    # Once when it is asked, for the sequence that it has seen, and then until it has ended.
    assert {counting.reads[reported_key(name)] for name in robots.names} <= {2, 3}


def test_a_robot_whose_application_crashes_after_it_was_in_sync_has_failed(yard: Yard) -> None:
    robots = PuppetRobots(yard.store, 5)
    robots.crashing = {"r0"}
    version = yard.publish({"run.sh": STAYS_UP})

    record = run(yard, robots, yard.request(version, "one"), version.digest)

    assert record.status == "Succeeded"
    assert recorded_progress(record)["r0"].status == "Failed"


def test_robots_that_crash_later_stop_the_roll_out_like_those_that_fail(yard: Yard) -> None:
    robots = PuppetRobots(yard.store, 25, step_s=6.0)
    robots.crashing = set(robots.names)
    version = yard.publish({"run.sh": STAYS_UP})
    request = yard.request(version, "one")
    modest = DeploymentConfig(concurrentDeploymentPercentage=4, failureThresholdPercentage=8)

    record = run(yard, robots, request.model_copy(update={"deploymentConfig": modest}), version.digest)

    assert (record.status, record.failure_code) == ("Failed", "FailureThresholdBreached")
    assert len(robots.asked()) < 10


def test_a_canary_that_crashes_later_stops_the_roll_out(yard: Yard) -> None:
    robots = PuppetRobots(yard.store, 20, step_s=12.0)
    robots.crashing = {"r0"}
    version = yard.publish({"run.sh": STAYS_UP})
    request = yard.request(version, "one")
    modest = DeploymentConfig(concurrentDeploymentPercentage=5, failureThresholdPercentage=100)
    rules = RollOutRules(canaryRobots=1)

    record = run(yard, robots, request.model_copy(update={"deploymentConfig": modest}), version.digest, rules=rules)

    assert "; a canary failed; 1 of 20 robots failed (r0: PreLaunchFileFailure)" in record.failure_reason
    assert len(robots.asked()) < 5


def test_robots_in_sync_are_looked_at_again_ever_less_often(yard: Yard) -> None:
    robots = PuppetRobots(yard.store, 8, step_s=10.0)
    robots.silent = {"r7"}
    version = yard.publish({"run.sh": STAYS_UP})
    counting = CountingStore(yard.store)
    request = yard.request(version, "one")
    patient = DeploymentConfig(concurrentDeploymentPercentage=100, robotDeploymentTimeoutInSeconds=2000)

    run(
        replace(yard, store=cast("Store", counting)),
        robots,
        request.model_copy(update={"deploymentConfig": patient}),
        version.digest,
    )

    assert counting.reads[reported_key("r7")] > 200
    assert counting.reads[reported_key("r0")] < 15


@pytest.mark.parametrize("after", [False, True])
def test_a_controller_waits_for_a_store_that_is_away(
    after: bool,  # noqa: FBT001 - a parameter of the test
    yard: Yard,
) -> None:
    version, robots = yard.publish({"run.sh": STAYS_UP}), PuppetRobots(yard.store, 3)
    waited = 0
    for nth in range(1, 40):
        failing = FailingStore(yard.store, nth, after=after)
        request = yard.request(version, f"run-{nth}")
        try:
            record = run(replace(yard, store=cast("Store", failing)), robots, request, version.digest)
        except StoreUnreachable:  # before the roll-out whoever asked for it is told at once
            known = [each for each in records(yard.store, KIND) if each.id == job_id(KIND, f"run-{nth}")]
            assert all("progress" not in each.detail for each in known)
            record = run(yard, robots, request, version.digest)
        else:
            waited += failing.left < 0
        assert record.status == "Succeeded"
        assert {desired.deployment for desired in robots.asked()} == {record.id}

    assert waited > 15


def test_robots_that_join_while_a_deployment_is_interrupted_are_not_part_of_it(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 4)
    robots.dies_after = 1
    with pytest.raises(StageFailed):
        run(yard, robots, yard.request(version, "one"), version.digest)
    create_robot(yard.store, "late")
    register_robot(yard.store, FLEET, "late")

    record = run(yard, robots, yard.request(version, "one"), version.digest)

    assert sorted(recorded_progress(record)) == robots.names


def test_a_controller_s_clock_goes_on_when_the_machine_s_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    right, ticks = time.time, time.monotonic
    pace = ControllerPace()
    before_s = pace.now_s()
    for set_by_s in (86_400.0, -86_400.0):
        monkeypatch.setattr(time, "time", lambda set_by_s=set_by_s: right() + set_by_s)
        monkeypatch.setattr(time, "monotonic", lambda: ticks() + 1000.0)
        assert pace.now_s() == pytest.approx(before_s + 1000.0, abs=100.0)
        monkeypatch.undo()


class SpoiltRobots(PuppetRobots):
    """One of the robots reports garbage only."""

    spoils = "r1"

    @property
    def pace(self) -> ControllerPace:
        self.silent.add(self.spoils)
        return ControllerPace(now_s=super().pace.now_s, sleep=self._sleep_and_spoil)

    def _sleep_and_spoil(self, seconds: float) -> None:
        self.store.put(reported_key(self.spoils), b'{"robot": "r1", "status": "Succ')
        self._sleep(60.0 if seconds else 0.0)


def test_a_robot_whose_reports_are_garbage_gives_no_answer_and_the_others_are_deployed_to(
    yard: Yard, caplog: pytest.LogCaptureFixture
) -> None:
    robots = SpoiltRobots(yard.store, 5, step_s=1000.0)
    version = yard.publish({"run.sh": STAYS_UP})

    record = run(yard, robots, yard.request(version, "one"), version.digest)

    codes = {robot: each.failure_code for robot, each in recorded_progress(record).items()}
    assert record.status == "Succeeded"
    assert codes == {**dict.fromkeys(robots.names), "r1": "RobotDeploymentNoResponse"}
    assert len([each for each in caplog.messages if "r1 is without news" in each]) == 1
    assert len(describe_deployment_job(yard.store, record.id).robotDeploymentSummary or ()) == 5


@pytest.mark.parametrize("key", [desired_key, reported_key])
def test_garbage_from_before_a_deployment_does_not_stop_it(key: Callable[[str], str], yard: Yard) -> None:
    robots = PuppetRobots(yard.store, 3)
    for name in robots.names:
        yard.store.put(key(name), b"\xff")
    version = yard.publish({"run.sh": STAYS_UP})

    assert run(yard, robots, yard.request(version, "one"), version.digest).status == "Succeeded"
