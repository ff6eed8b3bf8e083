"""ROS applications as the controllers of episodes: a launch file of ROS 1 or ROS 2, run as it is, in lock-step.

What the robots of all lanes sense goes out, Twists come back. The folder that the nodes of a chunk write to, logs and
temporary files, is gone with the chunk.
"""
# ruff: noqa: PLC0415 - what a kind of ROS needs is imported when an application of that kind is driven

import fcntl
import logging
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64

from specs.bundle_files import ColorCameraDeclaration
from specs.data.episode import CONTROL_S
from specs.data.physics import application_variables
from specs.errors import SimyardError
from specs.robomaker.simulation import SimulationJobErrorCode
from specs.ros_robot import ERROR_CODE, RECOVERIES, ROS_FILE, RosRobot
from tasks.ros.bag.message_log import MessageLog
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.ros.lockstep.exchange import (
    ExchangeTotals,
    FloorMap,
    GoalEnd,
    JointStates,
    Launch,
    Lockstep,
    RobotBase,
    Sensed,
    TwistCommand,
)
from tasks.ros.lockstep.robot_topics import LockstepRecorder
from tasks.ros.lockstep.sensor_topics import READINGS
from tasks.ros.process.lane_limits import NO_ROOM
from tasks.simulate.application.bundle_code import BundleCrash, CrashCode, timed_call
from tasks.simulate.application.contract import HostMap, Observation
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import base_of, compile_robot
from tasks.simulate.host.color_cameras import LanePictures
from tasks.simulate.host.controllers import HostApplication, HostBundle, HostStart
from tasks.simulate.host.declaration import ControllerKind, read_ros_robot
from tasks.simulate.host.ros_judge import Judgement, judged_by
from tasks.simulate.host.twist_drive import TwistMap, twist_map
from tasks.simulate.sensors.lidar import Lidar, ray_angles

_PREFIX = "simyard-ros-"
# A folder is made first and locked then: one so young may be about to be locked.
_YOUNG_S = 60.0


# A process that is killed cannot remove its folder. The next one that makes such a folder does: whose lock nobody
# holds is nobody's.
class RosHome:
    """A folder for the nodes of a chunk, locked as long as this process lives.

    Attributes:
        path: The folder.
    """

    def __init__(self) -> None:
        """Makes it, and removes those that nobody has any more."""
        remove_abandoned(Path(tempfile.gettempdir()))
        self.path = Path(tempfile.mkdtemp(prefix=_PREFIX))
        self._handle = _locked(self.path)

    def close(self) -> None:
        """Removes it with all that lies in it; a second call does nothing."""
        shutil.rmtree(self.path, ignore_errors=True)
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def remove_abandoned(folder: Path) -> None:
    """Removes the folders of processes that were killed.

    Args:
        folder: Where they lie.
    """
    for path in folder.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            if path.is_symlink() or time.time() - path.stat().st_mtime < _YOUNG_S:
                continue
            handle = _locked(path)
            if handle is not None:
                shutil.rmtree(path, ignore_errors=True)
                os.close(handle)


def _locked(path: Path) -> int | None:
    """Returns a handle on a folder that is locked as long as it is open; None if somebody else has locked it."""
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle


_FREE, _OCCUPIED = 0, 100
_PLANAR_JOINTS = 3
_ONE_NUMBER = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


class JointPlaces:
    """Where the joints that ``/joint_states`` tells of lie among a robot's coordinates and speeds.

    Attributes:
        names: Of the joints.
    """

    def __init__(self, robot: Path) -> None:
        """Reads them.

        Args:
            robot: Its ``robot.xml``.

        Raises:
            RobotRefused: It is no robot.
        """
        model = compile_robot(read_robot_mjcf(robot))
        first = 1 if base_of(model).free else _PLANAR_JOINTS
        told = [joint for joint in range(first, model.njnt) if mujoco.mjtJoint(model.jnt_type[joint]) in _ONE_NUMBER]
        self.names = tuple(model.joint(joint).name or f"joint_{joint}" for joint in told)
        self._positions = np.array([model.jnt_qposadr[joint] for joint in told], np.int64)
        self._speeds = np.array([model.jnt_dofadr[joint] for joint in told], np.int64)

    def of(self, observed: Observation, lane: int) -> JointStates | None:
        """Returns a lane's joints; None for a robot that is no more than its base."""
        if observed.joints is None or not self.names:
            return None
        qpos, qvel = np.asarray(observed.joints.qpos)[lane], np.asarray(observed.joints.qvel)[lane]
        return JointStates(self.names, qpos[self._positions].astype(np.float64), qvel[self._speeds].astype(np.float64))


class _Readings(dict[str, np.ndarray]):
    """What a lane's declared sensors read; its picture in colour is drawn when a message is made of it."""

    def __init__(self, given: Mapping[str, np.ndarray], lane: int, color: Callable[[], np.ndarray] | None) -> None:
        super().__init__({name: array[lane] for name, array in given.items()})
        self._lane, self._color = lane, color

    def __missing__(self, name: str) -> np.ndarray:
        if name != "color" or self._color is None:
            raise KeyError(name)
        return self._color()[self._lane]


class LaneSenses:
    """Turns the observations of all lanes into what each lane's nodes are told.

    Attributes:
        color: Returns what the colour cameras of all lanes see; None for robots without.
    """

    color: Callable[[], np.ndarray] | None = None

    def __init__(self, joints: JointPlaces) -> None:
        """Begins with robots that do not accelerate."""
        self._joints = joints
        self._before: Float64[np.ndarray, "lanes 3"] | None = None

    def sensed(self, observed: Observation, asked: Bool[np.ndarray, "lanes"]) -> list[Sensed | None]:
        """Returns what each lane's robot senses now; None for lanes that are not asked.

        Args:
            observed: Of all lanes, lanes first, in NumPy.
            asked: Which lanes; the others, idle ones at the end among them, are done.
        """
        pose = np.asarray(observed.pose, np.float64)
        velocity = np.asarray(observed.velocity, np.float64)
        change = velocity - (velocity if self._before is None else self._before)
        self._before = velocity
        own, acceleration = _turned_back(velocity, pose[:, 2]), _turned_back(change, pose[:, 2])[:, :2] / CONTROL_S
        ranges_m, bumper, goal_m = (np.asarray(each) for each in (observed.ranges_m, observed.bumper, observed.goal_m))
        given = ((name, getattr(observed, name)) for name in READINGS)
        readings = {name: np.asarray(array) for name, array in given if array is not None}
        return [
            Sensed(
                pose=pose[lane],
                velocity=own[lane],
                acceleration=acceleration[lane],
                ranges_m=ranges_m[lane],
                bumper=bumper[lane],
                goal=goal_m[lane].astype(np.float64),
                joints=self._joints.of(observed, lane),
                readings=_Readings(readings, lane, self.color),
            )
            if wanted
            else None
            for lane, wanted in enumerate(asked.tolist())
        ]


def robot_base(robot: RosRobot, lidar: Lidar) -> RobotBase:
    """Returns a base as nodes know it.

    Args:
        robot: What its bundle declares.
        lidar: As the program has it.
    """
    angles = ray_angles(lidar)
    if not len(angles):
        return RobotBase(robot, 0, 0.0, 0.0, float(lidar.range_m))
    step_rad = float(np.float64(angles[-1]) - np.float64(angles[0])) / max(len(angles) - 1, 1)
    return RobotBase(robot, len(angles), float(angles[0]), step_rad, float(lidar.range_m))


def floor_plan(floor: HostMap) -> FloorMap:
    """Returns a world's map as an occupancy grid has it, whose origin is the corner of its first cell.

    What reaches into the circle within a cell makes it occupied: by their middles alone, a chair's legs were on no map.
    """
    half_m = float(floor.cell_m) / 2
    cells = np.where(floor.clearance_m > half_m, _FREE, _OCCUPIED).astype(np.int8)
    x_m, y_m = (float(each) - half_m for each in floor.origin_m)
    return FloorMap(cells, (x_m, y_m), float(floor.cell_m))


def _turned_back(
    vectors: Float[np.ndarray, "lanes 3"], yaw_rad: Float[np.ndarray, "lanes"]
) -> Float64[np.ndarray, "lanes 3"]:
    """Returns vectors along the world's axes in the frames of robots that head there."""
    exact_rad = yaw_rad.astype(np.float64)  # as for the lidar's rays: docs/decisions/0042-directions-from-doubles.md
    cos, sin = np.cos(exact_rad), np.sin(exact_rad)
    ahead = cos * vectors[:, 0] + sin * vectors[:, 1]
    left = cos * vectors[:, 1] - sin * vectors[:, 0]
    return np.stack([ahead, left, vectors[:, 2]], axis=-1)


logger = logging.getLogger(__name__)
LockstepMaker = Callable[[RobotBase, Launch], Lockstep]
_ROBOT: CrashCode = "RobotApplicationCrash"
_SIMULATION: CrashCode = "SimulationApplicationCrash"


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
        self._traffic: LockstepRecorder | None = None
        self._cancelled = frozenset[int]()
        self._placings: dict[int, int] = {}
        self._tests: dict[int, bool] = {}
        self._goal_ends: dict[int, GoalEnd] = {}
        self._simulation_failed = {*range(len(start.lanes))} if _is_alone(setup.bundle) else set[int]()
        self._ended: dict[int, tuple[ExchangeTotals, Mapping[str, str]]] = {}

    def keep_traffic(self) -> None:
        """Keeps from now on what the first lane's robot and its nodes say to each other; said before the first step."""
        self._keeps = True

    @property
    def traffic(self) -> MessageLog | None:
        """Returns what was kept; None if nothing was."""
        return self._traffic and self._traffic.log()

    @property
    def cancelled(self) -> frozenset[int]:
        """Returns the lanes whose own application asked for the end of its job, or whose tests have ended."""
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

    @property
    def placed(self) -> Mapping[int, tuple[float, float, float]]:
        """Returns where nodes set robots while the last controls were found, by lane."""
        return self._lockstep.placed if self._lockstep else {}

    def measures(self, lane: int) -> Mapping[str, int]:
        """Returns how lock-step held in a lane: ``late`` and ``stray``."""
        tally = self._end(lane)[0]
        return {"late": tally.late, "stray": tally.stray}

    def metrics(self, lane: int) -> Mapping[str, float]:
        """Returns what a lane's navigation says of itself."""
        recoveries = self._end(lane)[0].recoveries
        return {} if recoveries is None else {RECOVERIES: float(recoveries)}

    def tags(self, lane: int) -> Mapping[str, str]:
        """Returns the tags that a lane's application gave to its job."""
        return self._end(lane)[1]

    def judgement(self, lane: int) -> Judgement | None:
        """Returns what a lane's application or its navigation says of it; None where the scenario alone judges."""
        if (end := self._goal_ends.get(lane)) is not None:
            code = {ERROR_CODE: str(end.error_code)}
            time_over = self._setup.robot.time_over
            return Judgement(passed=False, ended=True, time_over=time_over, tags=code, reason=end.reason)
        if self._setup.bundle.judge is None:
            return None
        tags = self.tags(lane)
        passed = judged_by(tags, tests=self._tests.get(lane))
        over, placings = self._setup.robot.time_over, self._placings.get(lane, 0)
        return Judgement(passed, lane in self._cancelled, over, tags, placings=placings)

    def failure_code(self, lane: int) -> SimulationJobErrorCode:
        """Returns whose crash a lane's is."""
        return _SIMULATION if lane in self._simulation_failed else _ROBOT

    def close(self) -> None:
        """Ends all applications; what they did stays known. A second call does nothing."""
        lockstep, self._lockstep = self._lockstep, None
        try:
            if lockstep is not None:
                self._ended = {
                    lane: (lockstep.tally(lane), dict(lockstep.tags(lane))) for lane in range(len(self._start.lanes))
                }
                self._tell_prints(lockstep)
                lockstep.close()
        finally:
            if self._home is not None:
                self._home.close()

    def _tell_prints(self, lockstep: Lockstep) -> None:
        """Prints what nodes printed, so that it becomes part of what applications printed."""
        for number, lane in enumerate(self._start.lanes):
            if said := lockstep.printed(number):
                sys.stdout.write(f"job {lane.request.index} of {self._name}:\n{said}\n")
        sys.stdout.flush()

    def _commands(self, sensed: Sequence[Sensed | None]) -> Sequence[TwistCommand]:
        """Returns each lane's command; the applications are started before the first.

        Raises:
            MemoryError: The machine has no room for so many processes.
        """
        stopped = [TwistCommand()] * len(sensed)
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
            environment=[application_variables(lane.request.environment) for lane in lanes],
            judging=[application_variables(lane.request.judge_variables) for lane in lanes],
            simulation=setup.bundle.judge and _source(setup.bundle.judge),
            command=setup.bundle.launch.command,
        )
        base = robot_base(setup.robot, self._start.sensors.lidar)
        lockstep = setup.make(base, launch)
        if self._keeps:
            lockstep = self._traffic = LockstepRecorder(lockstep, base, CONTROL_S)
        self._lockstep = lockstep  # what it holds is ended even if the applications never get ready
        wanted = setup.robot.topics.floor_map is not None
        lockstep.begin(sensed, [floor_plan(lane.arrays.floor) if wanted else None for lane in lanes])
        return lockstep

    def _without_lost(self, sensed: Sequence[Sensed | None]) -> list[Sensed | None]:
        """Returns what is sensed, without lanes whose applications failed or ended while they got ready."""
        assert self._lockstep is not None  # noqa: S101 - just begun
        lost = {*self._lockstep.failures, *self._lockstep.cancelled, *self._lockstep.tests, *self._lockstep.goal_ends}
        return [None if lane in lost else each for lane, each in enumerate(sensed)]

    def _note_failures(self, asked: Sequence[int], commands: Sequence[TwistCommand]) -> None:
        """Notes what became of lanes that were asked; what happens to those that are done changes no row."""
        if self._lockstep is None:
            return
        failures, cancelled = self._lockstep.failures, self._lockstep.cancelled | self._lockstep.tests.keys()
        self._tests.update(self._lockstep.tests)
        ends = self._lockstep.goal_ends
        self._goal_ends.update({lane: ends[lane] for lane in asked if lane in ends})
        cancelled |= self._goal_ends.keys()
        for lane in asked:
            if lane in failures:
                if self._lockstep.simulation_failed(lane):
                    self._simulation_failed.add(lane)
                self.crashes.setdefault(lane, self._reason(failures[lane]))
            elif not np.isfinite(commands[lane]).all():
                why = f"{self._setup.robot.topics.command}: a Twist that is not finite: {_shown(commands[lane])}"
                self.crashes.setdefault(lane, self._reason(why))
        self._cancelled |= cancelled & {*asked} - self.crashes.keys()
        for lane in self._lockstep.placed:
            self._placings[lane] = self._placings.get(lane, 0) + 1

    def _end(self, lane: int) -> tuple[ExchangeTotals, Mapping[str, str]]:
        if self._lockstep is not None:
            return self._lockstep.tally(lane), self._lockstep.tags(lane)
        return self._ended.get(lane, (ExchangeTotals(), {}))

    @property
    def _name(self) -> str:
        return self._setup.bundle.launch.name

    def _reason(self, why: str) -> str:
        return BundleCrash(_ROBOT, f"{self._name}: {why}").reason


def _source(bundle: HostBundle) -> LaunchSource:
    launch = bundle.launch
    return LaunchSource(bundle.folder, launch.package, launch.launch_file, launch.command)


def _is_alone(bundle: HostBundle) -> bool:
    return bundle.judge is not None and _source(bundle.judge) == _source(bundle)


def _shown(command: TwistCommand) -> str:
    return f"linear.x {command.ahead_m_s}, linear.y {command.left_m_s}, angular.z {command.turn_rad_s}"


class SeeingRosLanes(RosLanes):
    """The applications of lanes whose robots have colour cameras: the host draws what these see."""

    def __init__(self, setup: RosSetup, camera: ColorCameraDeclaration, start: HostStart) -> None:
        super().__init__(setup, start)
        self._pictures = LanePictures([camera] * len(start.lanes), start, setup.bundle.robot)
        self._senses.color = self._pictures.shown
        seen = self._pictures
        self.see, self.first_camera, self.drawn_again = seen.see, seen.first_camera, seen.drawn_again

    def controls(self, observed: Observation, moving: Bool[np.ndarray, "lanes"]) -> Float32[np.ndarray, "lanes nu"]:
        """Returns each moving lane's control; see ``RosLanes``."""
        able = moving.copy()
        able[[*self.crashes, *self._cancelled]] = False
        self._pictures.take(able)
        return super().controls(observed, moving)

    def failure_code(self, lane: int) -> SimulationJobErrorCode:
        """Returns whose crash a lane's is; see ``RosLanes``."""
        return self._pictures.failure_code(lane) if lane in self._pictures.undrawn else super().failure_code(lane)

    @property
    def gl(self) -> str:
        """Returns which GL drew; empty if nothing was drawn."""
        return self._pictures.gl


# What the robot has follows from ``ros.yaml`` and ``robot.xml`` at the bundle's root, before anything is started.
def ros_application(bundle: HostBundle, kind: ControllerKind, make: LockstepMaker) -> HostApplication:
    """Returns the application of a ROS launch file.

    Args:
        bundle: Where it lies.
        kind: ``ros`` or ``ros2``.
        make: Returns the lock-step with applications of that kind.

    Raises:
        BundleCrash: Its ``ros.yaml`` or its ``robot.xml`` is refused, or does not say what a Twist does.
    """
    try:
        robot = read_ros_robot(bundle.folder)
        _require_spoken(kind, robot)
        setup = RosSetup(bundle, robot, twist_map(bundle.robot, robot.drive), JointPlaces(bundle.robot), make)
    except RobotRefused as refused:
        raise BundleCrash("RobotApplicationCrash", f"{bundle.launch.name}: {refused}") from refused
    if bundle.judge is not None:  # it has goals of its own
        topics = robot.topics.model_copy(update={"goal": None})
        setup = setup._replace(robot=robot.model_copy(update={"topics": topics, "goals": "topic"}))
    sensors = declared_sensors(robot)

    def declare(environment: Mapping[str, object]) -> RosRobot:  # noqa: ARG001 - nodes read it, sensors do not
        return sensors

    def start(start: HostStart) -> RosLanes:
        camera = sensors.color_camera
        return RosLanes(setup, start) if camera is None else SeeingRosLanes(setup, camera, start)

    return HostApplication(kind, declare, start)


def _require_spoken(kind: ControllerKind, robot: RosRobot) -> None:
    """Refuses what only nodes of ROS 2 understand where nodes of ROS 1 drive, and types that nobody here knows.

    Raises:
        RobotRefused: Says what to change.
    """
    own = "move_base" if kind == "ros" else "navigate_to_pose"
    if robot.goals not in ("topic", own):
        raise RobotRefused(f"{ROS_FILE}: goals: {robot.goals}: not of this ROS, whose action is {own}")
    if kind == "ros":
        if robot.record:
            raise RobotRefused(f"{ROS_FILE}: record: nodes of ROS 2 alone are recorded: leave it out")
    elif robot.record:
        from tasks.ros.ros2.interface_types import type_store

        known = type_store().fielddefs
        for topic, name in robot.record.items():
            if name.replace("/", "/msg/") not in known:
                raise RobotRefused(f"{ROS_FILE}: record.{topic}: {name}: no type of ROS 2's common interfaces")


def declared_sensors(robot: RosRobot) -> RosRobot:
    """Returns a robot without the sensors that no topic tells of; it has the others as a controller object has them."""
    topics = robot.topics
    told = {
        "lidar": topics.scan,
        "bumper": topics.bumper,
        "depth_camera": topics.depth_image or topics.depth_points,
        "color_camera": topics.color_image,
        "imu": topics.imu,
        "range_finders": topics.range_finders,
        "compass": topics.compass,
        "gps": topics.gps,
    }
    return robot.model_copy(update={name: None for name, topic in told.items() if topic is None})


def ros1_lockstep(base: RobotBase, launch: Launch) -> Lockstep:
    """Returns the applications of ROS 1."""
    from tasks.ros.lockstep.ros1_lockstep import Ros1Lockstep

    return Ros1Lockstep(launch, base, CONTROL_S)


def ros2_lockstep(base: RobotBase, launch: Launch) -> Lockstep:
    """Returns the applications of ROS 2."""
    from tasks.ros.lockstep.ros2_lockstep import Ros2Lockstep

    return Ros2Lockstep(launch, base, CONTROL_S)
