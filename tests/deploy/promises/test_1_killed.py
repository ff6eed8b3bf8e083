"""Killed at any step, controllers and agents leave nothing lost, nothing twice, and no version broken."""

import signal
from collections.abc import Callable, Iterator
from itertools import count
from multiprocessing.context import ForkServerProcess

import pytest

from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.deploy.fleet.fleet_registry import read_reported
from tasks.deploy.fleet.states import Desired, Reported
from tasks.deploy.rollout.controller import ask_robot
from tasks.deploy.rollout.observation import recorded_progress
from tasks.storage.jobs.records import records
from tests.deploy.one_robot import desired
from tests.deploy.promises.figures import Figures, kind, sizes
from tests.deploy.promises.mortal import ROBOTS, control, process, serve
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import STAYS_UP, Yard, programs_of, wait_for_report
from tests.servers.eventually import eventually

pytestmark = pytest.mark.integration
_STRIDE = 7  # in short: one step in seven, others every time
SCRIPTS = {"before.sh": "#!/bin/sh\n", "after.sh": "#!/bin/sh\n"}
LAUNCH = DeploymentLaunchConfig(
    packageName="courier", preLaunchFile="before.sh", launchFile="run.sh", postLaunchFile="after.sh"
)


def _deaths(times: int, tries: Callable[[int, bool], bool]) -> int:
    """Returns how often somebody died: at each step ``times`` times, before it and after it in turn.

    ``tries`` lets one die at a step, and returns whether there was such a step.
    """
    kills, short = 0, times == 0
    for step in count(1):
        if short and step % _STRIDE != 1:
            continue
        for attempt in range(max(1, times)):
            if not tries(step, (attempt + step) % 2 == 0):
                return kills
            kills += 1
    raise AssertionError


@sizes(short=0, long=20)
def test_a_controller_that_is_killed_at_any_request_is_continued(yard: Yard, size: int, figures: Figures) -> None:
    version, robots = yard.publish({"run.sh": STAYS_UP}), PuppetRobots(yard.store, ROBOTS)
    jobs = count(1)

    def dies(step: int, after: bool) -> bool:  # noqa: FBT001 - as _deaths gives it
        job = next(jobs)
        request = yard.request(version, f"run-{job}")
        controller = process(control, yard.store.url, request.model_dump_json(), version.digest, step, after=after)
        controller.join()
        assert controller.exitcode in {0, -signal.SIGKILL}

        half = robots.asked()
        record = run(yard, robots, request, version.digest)

        assert (record.status, len(recorded_progress(record))) == ("Succeeded", ROBOTS)
        assert {each.deployment for each in robots.asked()} == {record.id}
        assert [each for each in half if each.deployment == record.id and each not in robots.asked()] == []
        return controller.exitcode != 0

    kills = _deaths(size, dies)

    assert kills > 5
    assert len(records(yard.store, "deployment-job")) == kills + 1
    figures(1, kind(yard.store.url), controllers_killed=kills, lost=0, twice=0)


@pytest.fixture
def agents() -> Iterator[list[ForkServerProcess]]:
    started: list[ForkServerProcess] = []
    yield started
    for agent in started:
        agent.kill()
        agent.join()


@sizes(short=0, long=20)
def test_an_agent_that_is_killed_at_any_step_finishes_after_its_next_start(
    yard: Yard, size: int, figures: Figures, agents: list[ForkServerProcess]
) -> None:
    versions = [yard.publish({**SCRIPTS, "run.sh": f"{STAYS_UP}# {number}\n"}) for number in (1, 2)]
    yard.store.put("buckets/mine/condition.sh", b"#!/bin/sh\nexit 0\n")
    sequences, root = count(1), yard.root("r1")
    root.mkdir(parents=True)

    def start(nth: int, *, after: bool = False) -> ForkServerProcess:
        agents.append(process(serve, yard.store.url, str(root), nth, after=after))
        return agents[-1]

    def dies(step: int, after: bool) -> bool:  # noqa: FBT001 - as _deaths gives it
        sequence = next(sequences)
        version = versions[sequence % 2]
        _ask(yard, desired(version, sequence, launch=LAUNCH, condition={"bucket": "mine", "key": "condition.sh"}))
        agent = start(step, after=after)
        eventually(lambda: not agent.is_alive() or _done(yard, sequence))
        died = not agent.is_alive()
        assert yard.current("r1") in {"", *(each.digest for each in versions)}
        agent.kill()
        agent.join()
        assert agent.exitcode == -signal.SIGKILL

        healthy = start(0)
        done = wait_for_report(yard, "r1", lambda told: told.sequence == sequence and told.status != "Deploying")
        assert (done.status, done.failure_reason) == ("InSync", "")
        assert yard.current("r1") == version.digest
        eventually(lambda: programs_of(root) == ["sleep 1000"])
        healthy.kill()
        healthy.join()
        return died

    kills = _deaths(size, dies)

    assert kills > 3
    installed = sorted(path.name for path in (root / "versions").iterdir())
    assert installed == sorted(version.digest for version in versions)
    figures(1, kind(yard.store.url), agents_killed=kills, lost=0, twice=0, broken=0)


def _ask(yard: Yard, wanted: Desired) -> None:
    assert ask_robot(yard.store, wanted).sequence == wanted.sequence


def _done(yard: Yard, sequence: int) -> bool:
    told: Reported | None = read_reported(yard.store, "r1")
    return told is not None and told.sequence == sequence and told.status == "InSync"
