"""Runs a bundle's scripts and its application on a robot, and starts the application again when it ends."""

import errno
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from specs.errors import BundleRefused, LaunchRefused, StoreError
from specs.launched_file import names_ros_launch
from specs.program_file import HEAD_BYTES, built_for, start_fault
from specs.robomaker.failure_codes import DeploymentJobErrorCode
from tasks.deploy.fleet.launch_environment import BASE_VARIABLES, absent_program, variable_faults
from tasks.deploy.fleet.states import Desired
from tasks.deploy.robot.account import Account, let_add_files
from tasks.deploy.robot.disk import Disk
from tasks.deploy.robot.install import StepFailed
from tasks.deploy.robot.processes import RunningProgram, Stop, start, wait
from tasks.ros.launch.robot_command import RobotRos, launch_command, make_python, own_variables, robot_ros
from tasks.storage.archives import safe_parts
from tasks.storage.image_files import HOME_ON_ROBOT, image_command, read_image

_FIRST_PAUSE_S = 0.5
_LONGEST_PAUSE_S = 30.0
_CRASHES = 5
_SETUP: DeploymentJobErrorCode = "EnvironmentSetupError"
# roslaunch reads its file and starts a master before the first node, and ends a while after the last one.
_ROS_START_S = 5.0


class CrashLoop(Exception):  # noqa: N818 - a state
    """An application ends again and again, soon after each start."""


@dataclass(frozen=True)
class LaunchPlace:
    """Where programs run.

    Attributes:
        robot: The robot's name.
        disk: Its folder.
        stop: Whether the agent may go on.
        grace_s: How long an application must stay up for its launch to count.
        account: Under which they run; None for the agent's own.
        home: Where they may write; None for the robot's folder.
    """

    robot: str
    disk: Disk
    stop: Stop
    grace_s: float
    account: Account | None = None
    home: Path | None = None


def check_launch(desired: Desired) -> None:
    """Does nothing for a launch configuration that may run here.

    Raises:
        StepFailed: It names files outside the bundle, or variables that no application may set.
    """
    refused = [fault.value for fault in variable_faults(desired.environment, "environmentVariables")]
    if refused:
        raise StepFailed("EnvironmentSetupError", f"these variables may not be set: {', '.join(refused)}")
    launch = desired.launch
    for name in (launch.preLaunchFile, launch.launchFile, launch.postLaunchFile):
        if name is not None:
            _parts(desired, name)


def check_bundle(place: LaunchPlace, desired: Desired) -> None:
    """Does nothing for a bundle that this robot can launch; a container image is unpacked for that.

    Raises:
        StepFailed: The robot lacks the ROS that a launch file is for, or what runs images, or the image what is named.
    """
    launch = desired.launch
    for name in filter(None, (launch.preLaunchFile, launch.postLaunchFile)):
        _in_image(place, desired, name)
    image = _in_image(place, desired, launch.launchFile)
    if image is None and names_ros_launch(launch.launchFile):
        _ros(desired)


def _in_image(place: LaunchPlace, desired: Desired, name: str) -> "Command | None":
    """Returns the command of a program, or a launch file of ROS, in a container image; None for another bundle."""
    # Not the robot's folder: what runs today could write into the images that are unpacked there.
    home, variables = place.home or place.disk.root / "home", {**desired.environment, **_own_variables(place, desired)}
    try:
        image, root = read_image(place.disk.version(desired.digest)), place.disk.image(desired.digest)
        if image is None or root is None:
            return None
        home.mkdir(mode=0o700, exist_ok=True)
        words = image.words(desired.launch.packageName, name)
        own = {**variables, "HOME": HOME_ON_ROBOT}
        return Command(image_command(root, image, words, own, home, on_robot=True), {})
    except BundleRefused as exc:
        raise StepFailed("ExtractingBundleFailure", str(exc)) from exc
    except (StoreError, OSError) as exc:  # this robot's disk is full, or read-only
        raise StepFailed("EnvironmentSetupError", str(exc)) from exc


def run_script(place: LaunchPlace, desired: Desired, name: str, step: str, code: DeploymentJobErrorCode) -> None:
    """Runs one of the bundle's scripts to its end, and ends whatever it leaves behind.

    Args:
        place: Where it runs.
        desired: What is deployed.
        name: The script's name in its package.
        step: What its log file is called after.
        code: RoboMaker's code for a failure of this step.

    Raises:
        StepFailed: With the code, when it is missing, exits with another code than 0, or takes too long.
        StopRequested: The agent has to end.
    """
    command = _in_image(place, desired, name)
    program = Path(name) if command else _program(place.disk, desired, name, code)
    run_program(place, desired, program, step, code, command=command)


def run_program(
    place: LaunchPlace,
    desired: Desired,
    program: Path,
    step: str,
    code: DeploymentJobErrorCode,
    *,
    command: "Command | None" = None,
) -> None:
    """Runs an executable file to its end, as `run_script` does.

    Args:
        place: Where it runs.
        desired: What is deployed.
        program: The file.
        step: What its log file is called after.
        code: RoboMaker's code for a failure of this step.
        command: What is run in its place.

    Raises:
        StepFailed: With the code, when it exits with another code than 0, or takes too long.
        StopRequested: The agent has to end.
    """
    running = _start(place, desired, program, step, code=code, command=command)
    try:
        ended = wait(running, desired.timeout_s, place.stop)
    finally:
        running.end()
    if ended is None:
        raise StepFailed(code, f"{program.name} took longer than {desired.timeout_s:g} s")
    if ended != 0:
        raise StepFailed(code, f"{program.name} {_exit(ended)}; its output is in {_log(place, desired, step)}")


class RunningApplication:
    """What a robot runs; started again when it ends, with growing pauses."""

    def __init__(self, place: LaunchPlace, desired: Desired, bring: Callable[[Desired], None]) -> None:
        """Starts it.

        Args:
            place: Where it runs.
            desired: What it is.
            bring: Makes its bundle, and nothing else, lie there; called before each start.

        Raises:
            StepFailed: The bundle cannot be brought, or the launch file is missing or cannot be executed.
        """
        self.desired = desired
        self._bring = bring
        self._place = place
        self._pause_s = _FIRST_PAUSE_S
        self._started_s = 0.0
        self._ended_s: float | None = None
        self._crashes = 0
        self._running = self._launch()

    def wait_until_up(self) -> None:
        """Waits for the grace period.

        Raises:
            StepFailed: The application ended within it.
            StopRequested: The agent has to end.
        """
        name = self.desired.launch.launchFile
        grace_s = self._place.grace_s + (_ROS_START_S if names_ros_launch(name) else 0.0)
        code = wait(self._running, grace_s, self._place.stop)
        if code is not None:
            log = _log(self._place, self.desired, "launch")
            reason = f"{name} {_exit(code)} within {grace_s:g} s of its launch"
            raise StepFailed("EnvironmentSetupError", f"{reason}, and has to stay up; its output is in {log}")

    def supervise(self) -> None:
        """Starts it again if it has ended and its pause is over; returns at once.

        Raises:
            CrashLoop: It has ended five times, none of them long after its start; raised again after five more.
            StepFailed: The bundle cannot be brought, or the launch file is missing or cannot be executed.
        """
        code = self._running.exit_code
        if code is None:
            return
        if self._ended_s is None:
            self._running.end()
            self._ended_s = time.monotonic()
            self._count(code)
        if time.monotonic() - self._ended_s >= self._pause_s:
            self._pause_s = min(self._pause_s * 2, _LONGEST_PAUSE_S)
            self._ended_s = time.monotonic()  # if it cannot be started, that is no crash: again after the pause
            self._running = self._launch()
            self._ended_s = None

    @property
    def has_settled(self) -> bool:
        """Whether it runs, and has run for longer than one that crashes in a loop."""
        return self._running.exit_code is None and time.monotonic() - self._started_s > _LONGEST_PAUSE_S

    def _count(self, code: int) -> None:
        if time.monotonic() - self._started_s > _LONGEST_PAUSE_S:
            self._pause_s, self._crashes = _FIRST_PAUSE_S, 0
            return
        self._crashes += 1
        if self._crashes % _CRASHES == 0:
            log = _log(self._place, self.desired, "launch")
            last = f"{self.desired.launch.launchFile} {_exit(code)} the last time; its output is in {log}"
            raise CrashLoop(f"the application ended {self._crashes} times, each soon after its start; {last}")

    def end(self) -> None:
        """Ends it and everything that it started."""
        self._running.end()

    def _launch(self) -> RunningProgram:
        self._bring(self.desired)
        name = self.desired.launch.launchFile
        if command := _in_image(self._place, self.desired, name):
            self._started_s = time.monotonic()
            return _start(self._place, self.desired, Path(name), "launch", code=_SETUP, command=command)
        if names_ros_launch(name):
            self._started_s = time.monotonic()
            return _start_ros(self._place, self.desired)
        program = _program(self._place.disk, self.desired, name, "MissingRobotDeploymentResource")
        self._started_s = time.monotonic()
        return _start(self._place, self.desired, program, "launch", code=_SETUP)


def _ros(desired: Desired) -> RobotRos:
    """Returns this robot's ROS that launches what is desired."""
    asked = {**own_variables(os.environ), **desired.environment}
    try:
        prefixes = asked.get("AMENT_PREFIX_PATH", "")
        return robot_ros(desired.launch.launchFile, asked.get("ROS_DISTRO", ""), prefixes=prefixes)
    except LaunchRefused as exc:
        raise StepFailed("EnvironmentSetupError", str(exc)) from exc


def _start_ros(place: LaunchPlace, desired: Desired) -> RunningProgram:
    ros, bundle, launch = _ros(desired), place.disk.version(desired.digest), desired.launch
    try:
        command = launch_command(ros, bundle, launch.packageName, launch.launchFile)
    except LaunchRefused as exc:
        raise StepFailed("MissingRobotDeploymentResource", str(exc)) from exc
    path = f"{BASE_VARIABLES['PATH']}:{make_python(place.disk.root / 'bin')}"
    # What nodes print shows in the log as they print it, and not when they end.
    variables = {**own_variables(os.environ), "PATH": path, "PYTHONUNBUFFERED": "1"}
    return _start(place, desired, ros.program, "launch", code=_SETUP, command=Command(command, variables))


class Command(NamedTuple):
    """What is run in place of a program: its arguments, and variables that it needs and a document may set."""

    arguments: Sequence[str]
    variables: Mapping[str, str]


def _start(
    place: LaunchPlace,
    desired: Desired,
    program: Path,
    step: str,
    *,
    code: DeploymentJobErrorCode,
    command: Command | None = None,
) -> RunningProgram:
    """Returns a program, started; the code is that of one that cannot be, for another reason than its rights."""
    arguments, more = command or Command([str(program)], {})
    variables = {**BASE_VARIABLES, **more, **desired.environment, **_own_variables(place, desired)}
    folder = place.disk.version(desired.digest)
    cwd = folder if folder.is_dir() else place.home or place.disk.root  # a condition runs before there is a bundle
    try:
        if place.account and cwd == folder:
            let_add_files(place.account, folder)
        return start(arguments, cwd, variables, place.disk.root, _log(place, desired, step), account=place.account)
    except OSError as exc:
        told: DeploymentJobErrorCode = "BadPermissionError" if isinstance(exc, PermissionError) else code
        raise StepFailed(told, f"{program.name} cannot be started: {_cause(program, exc)}") from exc
    except ValueError as exc:  # a variable that no program can be given
        raise StepFailed(_SETUP, f"{program.name} cannot be started: {exc}") from exc


def _own_variables(place: LaunchPlace, desired: Desired) -> dict[str, str]:
    home = str(place.home or place.disk.root)
    return {"SIMYARD_ROBOT": place.robot, "SIMYARD_DEPLOYMENT": desired.deployment, "HOME": home}


def _cause(program: Path, exc: OSError) -> str:
    """Returns why a program did not start, by what it begins with: the system says little, and of the wrong file."""
    if exc.errno == errno.EACCES:
        return f"{exc}: a folder above it is closed to the account that runs programs, or mounted with noexec"
    if exc.errno not in {errno.ENOENT, errno.ENOEXEC, errno.ELIBBAD}:
        return str(exc)
    try:
        with program.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError:
        return str(exc)
    if absent := absent_program(head):
        lacking = f"it needs {absent} (line 1), which this robot does not have"
    elif exc.errno == errno.ENOEXEC and (built := built_for(head)):
        lacking = f"it is compiled for {built}, and this robot is of architecture {platform.machine()}"
    else:
        lacking = f"{exc}: it is damaged, or built for another system than this robot's ({platform.machine()})"
    return start_fault(head, program.name) or lacking


def _program(disk: Disk, desired: Desired, name: str, code: DeploymentJobErrorCode) -> Path:
    program = disk.version(desired.digest).joinpath(*_parts(desired, name))
    where = f"{desired.launch.packageName}/{name}"
    if not program.is_file():
        raise StepFailed(code, f"the bundle has no file {where}")
    if not os.access(program, os.X_OK):
        raise StepFailed("BadPermissionError", f"{where} is not executable; chmod +x it and publish again")
    return program


def _parts(desired: Desired, name: str) -> tuple[str, ...]:
    try:
        return safe_parts(f"{desired.launch.packageName}/{name}")
    except BundleRefused as exc:
        raise StepFailed("MissingRobotDeploymentResource", str(exc)) from exc


def _log(place: LaunchPlace, desired: Desired, step: str) -> Path:
    return place.disk.logs / f"{desired.sequence:06d}-{step}.log"


def _exit(code: int) -> str:
    return f"was ended by signal {-code}" if code < 0 else f"exited with {code}"
