"""One robot in the process of the test."""

from collections.abc import Mapping
from typing import Any

from specs.robomaker.bundle import Version
from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.deploy.fleet.fleet_registry import read_reported
from tasks.deploy.fleet.states import Desired, Reported
from tasks.deploy.robot.disk import Disk
from tasks.deploy.robot.launch import LaunchPlace
from tasks.deploy.robot.processes import Stop
from tasks.deploy.robot.reported_state import Reporter
from tasks.deploy.robot.update import RobotUpdater
from tests.deploy.yard import STAYS_UP, Yard, desired_state, programs_of

GOOD = {"run.sh": STAYS_UP}
NAME = "r1"


class OneRobot:
    def __init__(self, yard: Yard) -> None:
        self.yard = yard
        self.stop = Stop()
        self.root = yard.root(NAME)
        self.store: Any = yard.store  # or something in front of it
        self.robot = self.restarted()

    def restarted(self, grace_s: float = 0.15) -> RobotUpdater:
        """Returns the robot with a new agent; a long grace is for applications that end by themselves."""
        place = LaunchPlace(robot=NAME, disk=Disk(self.root), stop=self.stop, grace_s=grace_s)
        self.robot = RobotUpdater(self.store, place, Reporter(self.store, NAME))
        return self.robot

    def deploy(self, version: Version, sequence: int, **changes: object) -> Reported:
        self.robot.accept(desired(version, sequence, **changes))
        reported = read_reported(self.yard.store, NAME)
        assert reported is not None
        return reported

    @property
    def programs(self) -> list[str]:
        return programs_of(self.root)


def desired(version: Version, sequence: int, **changes: object) -> Desired:
    fields: Mapping[str, object] = {
        "deployment": f"dep-{sequence}",
        "sequence": sequence,
        "version": version.number,
        "digest": version.digest,
        "timeout_s": 5.0,
    }
    return desired_state(**{**fields, **changes})


def scripted(**files: str) -> DeploymentLaunchConfig:
    return DeploymentLaunchConfig.model_validate({"packageName": "courier", "launchFile": "run.sh", **files})
