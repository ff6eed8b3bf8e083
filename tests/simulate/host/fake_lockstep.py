"""A lock-step without ROS: applications that drive to where their lidar sees most, and misbehave if told to."""

import math
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from specs.data.episode import ApplicationLaunch
from tasks.ros.lockstep.exchange import ExchangeTotals, FloorMap, GoalEnd, Launch, RobotBase, Sensed, TwistCommand
from tests.repository import ROOT

BUNDLE = "5" * 64
ROS_ROBOT = ApplicationLaunch(name="wheels", version="1", digest=BUNDLE, package="patrol", launch_file="drive.launch")
CRASHES, NOT_A_NUMBER, CANCELS, STRAYS, TAGS, NOT_READY = "crash", "nan", "cancel", "stray", "tags", "not-ready"
GIVES_UP = "gives-up"
_FAULT_STEP = 3


def ros_bundle(folder: Path, declaration: str = "") -> Path:
    """Returns a bundle of ROS with the courier's robot; its nodes are none that anybody starts."""
    launches = folder / "patrol" / "launch"
    launches.mkdir(parents=True)
    (folder / "patrol" / "package.xml").write_text("<package><name>patrol</name></package>")
    (launches / "drive.launch").write_text("<launch/>")
    shutil.copy(ROOT / "applications" / "courier" / "robot.xml", folder / "robot.xml")
    if declaration:
        (folder / "ros.yaml").write_text(declaration)
    return folder


class FakeLockstep:
    """The applications of all lanes; their variable ``KIND`` says how each misbehaves.

    Attributes:
        begun: What robots sensed, and their maps, when the applications were told to get ready.
        seen: What they sensed at each control step.
    """

    def __init__(self, base: RobotBase, launch: Launch) -> None:
        self.base, self.launch = base, launch
        self.failures: dict[int, str] = {}
        self.cancelled: frozenset[int] = frozenset()
        self.goal_ends: dict[int, GoalEnd] = {}
        self.begun: tuple[list[Sensed | None], list[FloorMap | None]] | None = None
        self.seen: list[list[Sensed | None]] = []
        self.placed: dict[int, tuple[float, float, float]] = {}
        self.closed = 0
        self._tallies = dict.fromkeys(range(len(launch.environment)), ExchangeTotals())
        self._tags: dict[int, dict[str, str]] = {}
        (launch.home / "log").write_text("what a node wrote")

    def begin(self, sensed: Sequence[Sensed | None], floors: Sequence[FloorMap | None]) -> None:
        self.begun = list(sensed), list(floors)
        for lane in self._of_kind(NOT_READY):
            self.failures[lane] = "node /patrol was not ready within 60 s"

    def exchange(self, sensed: Sequence[Sensed | None]) -> list[TwistCommand]:
        self.seen.append(list(sensed))
        if len(self.seen) == _FAULT_STEP:
            self.failures |= dict.fromkeys(self._of_kind(CRASHES), "node /patrol ended with status 7")
            self.cancelled |= frozenset(self._of_kind(CANCELS))
            self.goal_ends |= dict.fromkeys(self._of_kind(GIVES_UP), GoalEnd("aborted", 9002))
            self._tallies |= dict.fromkeys(self._of_kind(STRAYS), ExchangeTotals(3, late=2, stray=1, recoveries=4))
            self._tags |= {lane: {"lane": str(lane), "seen": "much"} for lane in self._of_kind(TAGS)}
        spoilt = set(self._of_kind(NOT_A_NUMBER)) if len(self.seen) == _FAULT_STEP else set[int]()
        return [
            TwistCommand(ahead_m_s=math.nan) if lane in spoilt else self._driven(each)
            for lane, each in enumerate(sensed)
        ]

    def tally(self, lane: int) -> ExchangeTotals:
        return self._tallies[lane]

    def tags(self, lane: int) -> Mapping[str, str]:
        return self._tags.get(lane, {})

    @property
    def tests(self) -> Mapping[int, bool]:
        return {}

    def heard(self, lane: int) -> Sequence[tuple[str, bytes]]:  # noqa: ARG002 - nothing is recorded
        return ()

    def simulation_failed(self, lane: int) -> bool:  # noqa: ARG002 - its nodes are the robot application's
        return False

    def printed(self, lane: int) -> str:
        return "patrol: no map" if lane in self._of_kind(NOT_READY) else ""

    def close(self) -> None:
        self.closed += 1

    def _of_kind(self, kind: str) -> list[int]:
        return [lane for lane, variables in enumerate(self.launch.environment) if variables.get("KIND") == kind]

    def _driven(self, sensed: Sensed | None) -> TwistCommand:
        if sensed is None:
            return TwistCommand()
        if not len(sensed.ranges_m):
            return TwistCommand(ahead_m_s=0.3)
        bearing = self.base.first_ray_rad + self.base.ray_step_rad * int(np.argmax(sensed.ranges_m))
        bearing = (bearing + math.pi) % (2 * math.pi) - math.pi
        return TwistCommand(ahead_m_s=0.3, turn_rad_s=max(-1.0, min(1.0, bearing)))


class FakeLocksteps:
    """Makes them, and keeps what it made."""

    def __init__(self) -> None:
        self.made: list[FakeLockstep] = []

    def __call__(self, base: RobotBase, launch: Launch) -> FakeLockstep:
        self.made.append(FakeLockstep(base, launch))
        return self.made[-1]
