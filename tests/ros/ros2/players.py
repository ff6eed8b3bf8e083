"""A bundle whose nodes play ROS 2's, a world that costs nothing, and what its nodes do in it."""

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from specs.ros_robot import RosRobot
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.ros.lockstep.exchange import ExchangeTotals, FloorMap, Launch, RobotBase, Sensed, TwistCommand
from tasks.ros.lockstep.ros2_lockstep import Ros2Lockstep
from tasks.ros.lockstep.step_driver import LockstepPatience
from tests.repository import ROOT
from tests.ros.pictures import readings

CONTROL_S = 0.05
RAYS = 90
_DATA = ROOT / "tests/data/ros2"
_MODULES = ("player", "avoidance")
_LAUNCH = """
import os

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    program = LaunchConfiguration("program")
    return LaunchDescription([
        DeclareLaunchArgument("program", default_value=EnvironmentVariable("PROGRAM", default_value="avoider")),
        Node(package="play", executable=program, name="player"),
        *[Node(package="play", executable=each, name=each) for each in os.environ.get("BESIDE", "").split()],
    ])
"""
_JUDGE = """
from launch import LaunchDescription
from launch.actions import ExecuteProcess
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription([
        ExecuteProcess(cmd=["gzserver", "hall.world"]),
        Node(package="play", executable="service_caller", name="judge"),
    ])
"""


def make_bundle(folder: Path) -> Path:
    """Returns a bundle with one package, its nodes run by this Python, which has cyclonedds."""
    package = folder / "play"
    (package / "scripts").mkdir(parents=True)
    (package / "launch").mkdir()
    (package / "package.xml").write_text("<package><name>play</name></package>")
    (package / "launch/play.launch.py").write_text(_LAUNCH)
    (package / "launch/judge.launch.py").write_text(_JUDGE)
    for source in sorted(_DATA.glob("*.py")):
        if source.stem in _MODULES:
            shutil.copy(source, package / "scripts")
        else:
            program = package / "scripts" / source.stem
            program.write_text(f"#!{sys.executable}\n{source.read_text()}")
            program.chmod(0o755)
    return folder


def make_base(robot: RosRobot | None = None) -> RobotBase:
    """Returns a robot with a lidar all around."""
    return RobotBase(robot or RosRobot(), rays=RAYS, first_ray_rad=-np.pi, ray_step_rad=2.0 * np.pi / RAYS, range_m=8.0)


class ToyWorld:
    """A point in a square room with four pillars."""

    def __init__(self, seed: int, robot: RosRobot | None = None) -> None:
        self._robot = robot or RosRobot()
        generator = np.random.default_rng(seed)
        self.pose = np.array([0.0, 0.0, generator.uniform(-3.0, 3.0)])
        self.velocity = np.zeros(3)
        self._pillars = np.array([[1.5, 0.8], [-1.0, 1.2], [0.5, -1.6], [-1.8, -1.0]])

    def sense(self) -> Sensed:
        """Returns what the robot senses."""
        angles = -np.pi + 2.0 * np.pi / RAYS * np.arange(RAYS) + self.pose[2]
        cos, sin = np.cos(angles), np.sin(angles)
        walls = np.minimum((3.0 * np.sign(cos) - self.pose[0]) / cos, (3.0 * np.sign(sin) - self.pose[1]) / sin)
        away = self._pillars - self.pose[:2]
        along = away[:, :1] * cos + away[:, 1:] * sin
        off2 = (away**2).sum(axis=1)[:, None] - along**2
        hits = np.where((off2 < 0.0625) & (along > 0), along - np.sqrt(np.maximum(0.0625 - off2, 0.0)), np.inf)
        ranges = np.minimum(np.minimum(walls, hits.min(axis=0)), 8.0).astype(np.float32)
        goal, bumper = np.array([2.0, 2.0]), np.zeros(0, bool)
        more = readings(self._robot, ranges)
        return Sensed(self.pose.copy(), self.velocity.copy(), np.zeros(2), ranges, bumper, goal, None, more)

    def drive(self, command: TwistCommand) -> None:
        """Moves the robot for a control step."""
        self.velocity = np.array(command)
        x, y, yaw = self.pose
        x += CONTROL_S * (command.ahead_m_s * np.cos(yaw) - command.left_m_s * np.sin(yaw))
        y += CONTROL_S * (command.ahead_m_s * np.sin(yaw) + command.left_m_s * np.cos(yaw))
        self.pose = np.array([np.clip(x, -2.7, 2.7), np.clip(y, -2.7, 2.7), yaw + CONTROL_S * command.turn_rad_s])


class Run:
    """What came of some episodes.

    Attributes:
        commands: Of each lane, by control step.
        scans: What the first lane's robot saw.
        digests: Of each lane's commands.
        tallies: Of each lane.
        failures: By lane.
        cancelled: Lanes that asked for their end.
        tags: Of the first lane.
        goal_ends: By lane.
        poses: Where the robots are at the end.
    """

    def __init__(
        self,
        lockstep: Ros2Lockstep,
        lanes: int,
        steps: int,
        floor: FloorMap | None = None,
        robot: RosRobot | None = None,
    ) -> None:
        worlds = [ToyWorld(seed, robot) for seed in range(lanes)]
        self.commands: list[list[TwistCommand]] = [[] for _ in worlds]
        self.scans: list[np.ndarray] = []
        lockstep.begin([world.sense() for world in worlds], [floor] * lanes)
        for _ in range(steps):
            over = lockstep.failures.keys() | lockstep.goal_ends.keys()
            sensed: list[Sensed | None] = [
                None if number in over else world.sense() for number, world in enumerate(worlds)
            ]
            if sensed[0] is not None:
                self.scans.append(sensed[0].ranges_m)
            for number, command in enumerate(lockstep.exchange(sensed)):
                self.commands[number].append(command)
                worlds[number].drive(command)
        self.digests = [hashlib.sha256(np.array(each).tobytes()).hexdigest()[:12] for each in self.commands]
        self.tallies: Sequence[ExchangeTotals] = [lockstep.tally(number) for number in range(lanes)]
        self.failures: Mapping[int, str] = lockstep.failures
        self.cancelled, self.tags = lockstep.cancelled, lockstep.tags(0)
        self.goal_ends, self.poses = lockstep.goal_ends, [world.pose for world in worlds]


def drive(
    folder: Path,
    program: str | Sequence[str],
    lanes: int = 1,
    steps: int = 60,
    patience: LockstepPatience | None = None,
    *,
    judged: bool = False,
    robot: RosRobot | None = None,
    environments: Sequence[Mapping[str, str]] | None = None,
) -> Run:
    """Returns what came of episodes whose lanes run a program each, or all the same; ``a+b`` are two nodes of one.

    Where they are judged, ``service_caller`` runs beside them, of another bundle, whose launch file starts Gazebo.
    """
    programs = [program] * lanes if isinstance(program, str) else list(program)
    bundle = folder / "bundle"
    if not bundle.is_dir():
        make_bundle(bundle)
    judge = LaunchSource(make_bundle(folder / "judge"), "play", "judge.launch.py") if judged else None
    more = environments or [{}] * len(programs)
    variables = [{**_variables(each), **own} for each, own in zip(programs, more, strict=True)]
    launch = Launch(bundle, "play", "play.launch.py", folder / "home", variables, judge)
    with Ros2Lockstep(launch, make_base(robot), CONTROL_S, patience=patience) as lockstep:
        return Run(lockstep, lanes, steps)


def _variables(programs: str) -> dict[str, str]:
    first, *others = programs.split("+")
    return {"PROGRAM": first, "BESIDE": " ".join(others)}


def compiled(compiler: str, output: Path, *words: str) -> None:
    """Compiles a file, or skips the test where the compiler is not here."""
    if shutil.which(compiler) is None and os.environ.get("CI") != "true":
        pytest.skip(f"{compiler} is not here")
    done = subprocess.run([compiler, "-o", output, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def make_rclcpp(prefix: Path) -> Path:
    """Returns a folder like that of rclcpp: with a library of its name, by which a process is known to have it."""
    for name in ("lib", "share/ament_index"):
        (prefix / name).mkdir(parents=True)
    compiled("cc", prefix / "lib/librclcpp.so", "-shared", "-fPIC", "-x", "c", os.devnull)
    return prefix
