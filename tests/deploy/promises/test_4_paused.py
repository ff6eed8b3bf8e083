"""A controller that is paused with SIGSTOP is replaced in time, and writes nothing when it wakes up."""

import os
import signal
import time
from collections.abc import Iterator, Mapping
from multiprocessing.context import ForkServerProcess
from random import Random

import pytest

from specs.robomaker.bundle import Version
from tasks.deploy.rollout.observation import recorded_progress
from tasks.storage.base.keys import claim_key
from tasks.storage.jobs.claim import ClaimRecord
from tasks.storage.jobs.records import job_id, read
from tests.deploy.promises.figures import Figures, kind, sizes
from tests.deploy.promises.mortal import PAUSABLE, TTL_S, pausable, process
from tests.deploy.puppets import PuppetRobots
from tests.deploy.yard import STAYS_UP, Yard
from tests.servers.eventually import eventually

pytestmark = pytest.mark.integration
KIND = "deployment-job"
_LATEST_PAUSE_S = 0.5


@pytest.fixture
def controllers() -> Iterator[list[ForkServerProcess]]:
    started: list[ForkServerProcess] = []
    yield started
    for controller in started:
        controller.kill()
        controller.join()


@sizes(short=1, long=20)
def test_who_was_replaced_while_it_was_paused_writes_nothing(
    yard: Yard, size: int, figures: Figures, controllers: list[ForkServerProcess]
) -> None:
    version, dice = yard.publish({"run.sh": STAYS_UP}), Random(size)  # noqa: S311 - when it is paused
    robots, longest_s, held_up = PuppetRobots(yard.store, PAUSABLE), 0.0, 0
    for number in range(size):
        first = _started(yard, version, f"run-{number}", controllers)
        _wait_until_asked(robots, f"run-{number}")
        second = _started(yard, version, f"run-{number}", controllers)
        time.sleep(dice.uniform(0, _LATEST_PAUSE_S))
        _signal(first, signal.SIGSTOP)
        paused_s = time.monotonic()
        eventually(lambda number=number: _claim(yard, f"run-{number}").epoch > 1)
        longest_s = max(longest_s, time.monotonic() - paused_s)
        if not _ended_well(yard, second):
            held_up += 1
            _go_on_without(yard, version, f"run-{number}", first, controllers)
        else:
            _wakes_up_to_nothing(yard, first)

        record = read(yard.store, KIND, job_id(KIND, f"run-{number}"))
        assert (record.status, len(recorded_progress(record))) == ("Succeeded", PAUSABLE)
        assert {each.deployment for each in robots.asked()} == {record.id}
    _write_down(figures, yard, paused=size, held_up=held_up, ttl_s=TTL_S, longest_fail_over_s=round(longest_s, 2))


@sizes(short=1, long=20)
def test_who_was_canceled_while_it_was_paused_writes_nothing(
    yard: Yard, size: int, figures: Figures, controllers: list[ForkServerProcess]
) -> None:
    version, dice = yard.publish({"run.sh": STAYS_UP}), Random(size)  # noqa: S311 - when it is paused
    robots, held_up = PuppetRobots(yard.store, PAUSABLE), 0
    for number in range(size):
        first = _started(yard, version, f"old-{number}", controllers)
        _wait_until_asked(robots, f"old-{number}")
        time.sleep(dice.uniform(0, _LATEST_PAUSE_S))
        _signal(first, signal.SIGSTOP)
        second = _started(yard, version, f"new-{number}", controllers)
        if not _ended_well(yard, second):
            held_up += 1
            _go_on_without(yard, version, f"new-{number}", first, controllers)
        else:
            _wakes_up_to_nothing(yard, first)

        assert read(yard.store, KIND, job_id(KIND, f"old-{number}")).status == "Canceled"
        assert {each.deployment for each in robots.asked()} == {job_id(KIND, f"new-{number}")}
    _write_down(figures, yard, paused_and_canceled=size, held_up=held_up)


def _ended_well(yard: Yard, second: ForkServerProcess) -> bool:
    """Returns whether who took over came to its end; it may not when the other was paused with a lock on a folder."""
    second.join()
    if second.exitcode:
        assert kind(yard.store.url) == "file"
    return second.exitcode == 0


def _go_on_without(
    yard: Yard, version: Version, token: str, sleeper: ForkServerProcess, controllers: list[ForkServerProcess]
) -> None:
    """Lets the one with the lock go on, which must not finish the work; another one does."""
    _signal(sleeper, signal.SIGCONT)
    sleeper.join()
    third = _started(yard, version, token, controllers)
    third.join()
    assert third.exitcode == 0


def _write_down(figures: Figures, yard: Yard, *, held_up: int, **counts: int | float) -> None:
    kept = {"held_up_by_its_lock": held_up} if kind(yard.store.url) == "file" else {}
    figures(4, kind(yard.store.url), **counts, **kept, old_writes=0)


def _started(yard: Yard, version: Version, token: str, controllers: list[ForkServerProcess]) -> ForkServerProcess:
    request = yard.request(version, token).model_dump_json()
    controllers.append(process(pausable, yard.store.url, request, version.digest))
    return controllers[-1]


def _wait_until_asked(robots: PuppetRobots, token: str) -> None:
    job = job_id(KIND, token)
    eventually(lambda: any(each.deployment == job for each in robots.asked()))


def _wakes_up_to_nothing(yard: Yard, sleeper: ForkServerProcess) -> None:
    before = _written(yard)
    _signal(sleeper, signal.SIGCONT)
    sleeper.join()
    assert sleeper.exitcode != -signal.SIGKILL
    assert _written(yard) == before


def _signal(controller: ForkServerProcess, number: signal.Signals) -> None:
    assert controller.pid
    os.kill(controller.pid, number)


def _claim(yard: Yard, token: str) -> ClaimRecord:
    return ClaimRecord.model_validate_json(yard.store.get(claim_key(KIND, job_id(KIND, token))).body)


def _written(yard: Yard) -> Mapping[str, bytes]:
    """Returns what controllers write; the claim and the robots' reports are others' matter."""
    keys = [*yard.store.keys("robots"), *yard.store.keys("jobs"), *yard.store.keys("fleets")]
    return {key: yard.store.get(key).body for key in keys if not key.endswith("reported.json")}
