"""A controller whose robots' objects somebody has spoilt."""

from collections.abc import Callable

import pytest

from tasks.deploy.fleet_descriptions import describe_deployment_job
from tasks.deploy.rollout.controller import ControllerPace
from tasks.deploy.rollout.observation import recorded_progress
from tasks.storage.base.keys import desired_key, reported_key
from tests.deploy.puppets import PuppetRobots, run
from tests.deploy.yard import STAYS_UP, Yard


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
