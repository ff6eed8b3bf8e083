"""Roll-outs with robots that are silent, controllers that die, and agents that outlive them."""

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import cast

import pytest

from specs.errors import (
    StageFailed,
    StoreUnreachable,
)
from tasks.deploy.controller import recorded_progress
from tasks.deploy.robots import create_robot, read_desired, read_reported, register_robot
from tasks.storage.keys import reported_key
from tasks.storage.records import records
from tasks.storage.store import Store
from tests.deploy.puppets import CountingStore, FailingStore, PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard, eventually, kill

KIND = "deployment-job"
CONTROLLER = """
import sys
from specs.deployment import CreateDeploymentJobRequest
from tasks.deploy.job import run_deployment_job
from tasks.storage.opening import open_store
request = CreateDeploymentJobRequest.model_validate_json(sys.argv[2])
run_deployment_job(open_store(sys.argv[1]), request, digest=sys.argv[3], token=sys.argv[4],
                   progress=lambda ended, robots: print(ended, flush=True))
"""


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
        record = run(yard, robots, request, version.digest)

        assert (record.status, len(recorded_progress(record))) == ("Succeeded", 3)
        assert {(desired.sequence, desired.deployment) for desired in robots.asked()} == {(nth, record.id)}

    assert nth > 30, "every request of a whole deployment was tried"
    assert len(records(yard.store, KIND)) == nth


def test_a_robot_that_has_ended_is_not_asked_about_again(yard: Yard) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    robots = PuppetRobots(yard.store, 8)
    counting = CountingStore(yard.store)

    run(replace(yard, store=cast("Store", counting)), robots, yard.request(version, "one"), version.digest)

    # Once when it is asked, for the sequence that it has seen, and then until it has ended.
    assert {counting.reads[reported_key(name)] for name in robots.names} <= {2, 3}


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


@pytest.fixture
def agents(yard: Yard) -> Iterator[list[str]]:
    names = [f"r{number}" for number in range(3)]
    for name in names:
        create_robot(yard.store, name)
        register_robot(yard.store, FLEET, name)
    started = [yard.start_agent(name) for name in names]
    yield names
    for agent in started:
        kill(agent)


@pytest.mark.integration
def test_a_controller_process_that_is_killed_is_continued_and_every_robot_launches_once(
    yard: Yard, agents: list[str]
) -> None:
    version = yard.publish({"run.sh": STAYS_UP})
    request = yard.request(version, "one")
    argv = [sys.executable, "-c", CONTROLLER, yard.store.url, request.model_dump_json(), version.digest, "one"]
    with subprocess.Popen(argv, stdout=subprocess.PIPE) as controller:
        assert controller.stdout
        controller.stdout.readline()
        kill(controller)
    assert any(read_reported(yard.store, name) for name in agents)

    record = yard.deploy(version, "one")

    assert record.status == "Succeeded"
    for name in agents:
        eventually((yard.root(name) / "launches").exists)
    assert [(yard.root(name) / "launches").read_text() for name in agents] == ["up\n"] * 3
    assert [desired.sequence for name in agents if (desired := read_desired(yard.store, name)[0])] == [1] * 3
