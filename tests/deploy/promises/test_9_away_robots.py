"""A robot that was away counts as failed, and takes the latest alone when it is back."""

import subprocess
from collections.abc import Iterator

import pytest

from tasks.deploy.fleet.fleet_registry import create_robot, read_reported, register_robot
from tasks.deploy.fleet_descriptions import describe_robot
from tasks.deploy.rollout.deployment_job import run_sync_job
from tasks.deploy.rollout.observation import recorded_progress
from tests.deploy.promises.figures import Figures, kind, sizes
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import FLEET, STAYS_UP, Yard, kill, programs_of, wait_for_report
from tests.servers.eventually import eventually

pytestmark = pytest.mark.integration


@pytest.fixture
def agents() -> Iterator[list[subprocess.Popen[bytes]]]:
    started: list[subprocess.Popen[bytes]] = []
    yield started
    for agent in started:
        kill(agent)


@sizes(short=1, long=20)
def test_a_robot_that_was_away_takes_the_latest_alone(
    yard: Yard, size: int, figures: Figures, agents: list[subprocess.Popen[bytes]]
) -> None:
    robots = PuppetRobots(yard.store, 4, step_s=10_000.0)
    create_robot(yard.store, "away")
    register_robot(yard.store, FLEET, "away")
    versions = [yard.publish({"run.sh": f"{STAYS_UP}# {number}\n"}) for number in range(3)]
    missed = 0
    for number in range(size):
        jobs: list[str] = []
        for version in versions:
            missed += 1
            record = run(yard, robots, yard.request(version, f"run-{missed}"), version.digest)
            away = recorded_progress(record)["away"]
            assert record.status == "Succeeded"
            assert (away.status, away.failure_code) == ("NoResponse", "RobotDeploymentNoResponse")
            jobs.append(record.id)
        agents.append(yard.start_agent("away"))

        wait_for_report(yard, "away", lambda told, last=jobs[-1]: told.deployment == last and told.status == "InSync")

        assert yard.current("away") == versions[-1].digest
        eventually(lambda: programs_of(yard.root("away")) == ["sleep 1000"])
        assert (yard.root("away") / "launches").read_text() == "up\n" * (number + 1 + number)
        assert describe_robot(yard.store, "away").status == "InSync"
        synced = run_sync_job(yard.store, FLEET, token=f"sync-{number}", progress=lambda *_: None, pace=robots.pace)
        assert list(recorded_progress(synced)) == [], "nobody is behind"
        kill(agents[-1])
    reported = read_reported(yard.store, "away")
    assert reported is not None
    figures(9, kind(yard.store.url), returns=size, missed=missed, older_installed=0)
