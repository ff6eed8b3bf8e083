"""Drives the lanes of a chunk with ROS applications, in lock-step: what robots sense goes out, Twists come back."""

import logging
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32

from specs.bundle.ros_robot import RosRobot
from specs.data.episode import CONTROL_S
from specs.errors import SimyardError
from tasks.ros.bag.message_log import MessageLog
from tasks.ros.lockstep.exchange import Base, Command, Launch, Lockstep, Sensed, Tally
from tasks.ros.lockstep.traffic import Traffic
from tasks.ros.process.lane_limits import NO_ROOM
from tasks.simulate.application.call_clock import timed_call
from tasks.simulate.application.code import BundleCrash, CrashCode
from tasks.simulate.application.contract import Observation
from tasks.simulate.host.controllers import HostBundle, HostStart
from tasks.simulate.host.drive.twist import TwistMap
from tasks.simulate.host.ros_lane.ros_home import RosHome
from tasks.simulate.host.ros_lane.ros_senses import JointPlaces, LaneSenses, floor_plan, told_base

logger = logging.getLogger(__name__)
LockstepMaker = Callable[[Base, Launch], Lockstep]
_ROBOT: CrashCode = "RobotApplicationCrash"


class RosSetup(NamedTuple):
    """A ROS robot as its bundle describes it.

    Attributes:
        bundle: Where it lies, and what is launched.
        robot: What it declares.
        twists: How a Twist becomes controls.
        joints: What ``/joint_states`` tells of.
        make: Returns the lock-step with its applications.
    """

    bundle: HostBundle
    robot: RosRobot
    twists: TwistMap
    joints: JointPlaces
    make: LockstepMaker


class RosLanes:
    """The applications of a chunk's lanes; see ``tasks.simulate.host.controllers.HostControllers``.

    Nothing is started before the first control step: a chunk that is never driven leaves nothing to end.

    Attributes:
        crashes: Why applications failed, by lane.
    """

    def __init__(self, setup: RosSetup, start: HostStart) -> None:
        self.crashes: dict[int, str] = {}
        self._setup, self._start = setup, start
        self._senses = LaneSenses(setup.joints)
        self._lockstep: Lockstep | None = None
        self._home: RosHome | None = None
        self._keeps = False
        self._traffic: Traffic | None = None
        self._cancelled = frozenset[int]()
        self._ended: dict[int, tuple[Tally, Mapping[str, str]]] = {}

    def keep_traffic(self) -> None:
        """Keeps from now on what the first lane's robot and its nodes say to each other; said before the first step."""
        self._keeps = True

    @property
    def traffic(self) -> MessageLog | None:
        """Returns what was kept; None if nothing was."""
        return self._traffic and self._traffic.log()

    @property
    def cancelled(self) -> frozenset[int]:
        """Returns the lanes whose own application asked for the end of its job."""
        return self._cancelled

    def controls(self, observed: Observation, moving: Bool[np.ndarray, "lanes"]) -> Float32[np.ndarray, "lanes nu"]:
        """Returns each moving lane's control; not a number for one that failed or is cancelled, now or before.

        Args:
            observed: Of all lanes, lanes first, in NumPy.
            moving: Lanes that are not done.
        """
        lanes = len(self._start.lanes)
        asked = np.array(moving)
        asked[[*self.crashes, *self._cancelled]] = False
        sensed = self._senses.sensed(observed, asked)[:lanes]
        commands = self._commands(sensed)
        self._note_failures(np.flatnonzero(asked).tolist(), commands)
        controls = np.zeros((len(moving), self._start.actuators), np.float32)
        yaw_rad = np.asarray(observed.pose)[:lanes, 2]
        controls[:lanes] = self._setup.twists.controls(np.array(commands, np.float64), yaw_rad)
        controls[[*self.crashes, *self._cancelled]] = np.nan
        return controls

    def measures(self, lane: int) -> Mapping[str, int]:
        """Returns how lock-step held in a lane: ``late`` and ``stray``."""
        tally = self._end(lane)[0]
        return {"late": tally.late, "stray": tally.stray}

    def tags(self, lane: int) -> Mapping[str, str]:
        """Returns the tags that a lane's application gave to its job."""
        return self._end(lane)[1]

    def close(self) -> None:
        """Ends all applications; what they did stays known. A second call does nothing."""
        lockstep, self._lockstep = self._lockstep, None
        try:
            if lockstep is not None:
                self._ended = {
                    lane: (lockstep.tally(lane), dict(lockstep.tags(lane))) for lane in range(len(self._start.lanes))
                }
                self._tell_prints()
                lockstep.close()
        finally:
            if self._home is not None:
                self._home.close()

    def _tell_prints(self) -> None:
        """Prints what nodes printed, so that it becomes part of what applications printed."""
        for number, lane in enumerate(self._start.lanes):
            if self._home is not None and (said := self._home.printed(number)):
                sys.stdout.write(f"job {lane.request.index} of {self._name}:\n{said}\n")
        sys.stdout.flush()

    def _commands(self, sensed: Sequence[Sensed | None]) -> Sequence[Command]:
        """Returns each lane's command; the applications are started before the first.

        Raises:
            MemoryError: The machine has no room for so many processes.
        """
        stopped = [Command()] * len(sensed)
        if not any(each is not None for each in sensed):
            return stopped
        doing = f"{self._name}: a control step of {len(sensed)} ROS applications"
        try:
            with timed_call("nodes", _ROBOT, doing):
                if self._lockstep is None:
                    self._lockstep = self._begun(sensed)
                    sensed = self._without_lost(sensed)
                return self._lockstep.exchange(sensed)
        except SimyardError as exc:
            driven = [lane for lane, each in enumerate(sensed) if each is not None]
            self.crashes.update(dict.fromkeys(driven, self._reason(str(exc))))
            return stopped
        except OSError as exc:
            if exc.errno in NO_ROOM:
                raise MemoryError(f"{doing}: {exc}") from exc
            raise

    def _begun(self, sensed: Sequence[Sensed | None]) -> Lockstep:
        setup, lanes = self._setup, self._start.lanes
        self._home = RosHome()
        launch = Launch(
            bundle=setup.bundle.folder,
            package=setup.bundle.launch.package,
            launch_file=setup.bundle.launch.launch_file,
            home=self._home.path,
            environment=[lane.request.environment for lane in lanes],
        )
        base = told_base(setup.robot, self._start.sensors.lidar)
        lockstep = setup.make(base, launch)
        if self._keeps:
            lockstep = self._traffic = Traffic(lockstep, base, CONTROL_S)
        self._lockstep = lockstep  # what it holds is ended even if the applications never get ready
        wanted = setup.robot.topics.floor_map is not None
        lockstep.begin(sensed, [floor_plan(lane.stage.floor) if wanted else None for lane in lanes])
        return lockstep

    def _without_lost(self, sensed: Sequence[Sensed | None]) -> list[Sensed | None]:
        """Returns what is sensed, without lanes whose applications failed or ended while they got ready."""
        assert self._lockstep is not None  # noqa: S101 - just begun
        lost = {*self._lockstep.failures, *self._lockstep.cancelled}
        return [None if lane in lost else each for lane, each in enumerate(sensed)]

    def _note_failures(self, asked: Sequence[int], commands: Sequence[Command]) -> None:
        """Notes what became of lanes that were asked; what happens to those that are done changes no row."""
        if self._lockstep is None:
            return
        failures, cancelled = self._lockstep.failures, self._lockstep.cancelled
        for lane in asked:
            if lane in failures:
                self.crashes.setdefault(lane, self._reason(failures[lane]))
            elif not np.isfinite(commands[lane]).all():
                why = f"{self._setup.robot.topics.command}: a Twist that is not finite: {_shown(commands[lane])}"
                self.crashes.setdefault(lane, self._reason(why))
        self._cancelled |= cancelled.intersection(asked) - self.crashes.keys()

    def _end(self, lane: int) -> tuple[Tally, Mapping[str, str]]:
        if self._lockstep is not None:
            return self._lockstep.tally(lane), self._lockstep.tags(lane)
        return self._ended.get(lane, (Tally(), {}))

    @property
    def _name(self) -> str:
        return self._setup.bundle.launch.name

    def _reason(self, why: str) -> str:
        return BundleCrash(_ROBOT, f"{self._name}: {why}").reason


def _shown(command: Command) -> str:
    return f"linear.x {command.ahead_m_s}, linear.y {command.left_m_s}, angular.z {command.turn_rad_s}"
