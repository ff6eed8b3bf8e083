"""ROS 1 of this machine's own: an environment for its programs, and an episode that goes on while they run."""

import asyncio
import subprocess
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tasks.ros.message import ros_messages
from tasks.ros.message.ros_messages import PlanarTwist, stamp
from tests.ros.graph.episode import Episode

PYTHON = "/usr/bin/python3"
_STEP_NS = 20_000_000


class Ended(NamedTuple):
    """How a program ended, and what it wrote."""

    status: int
    output: str


class RosEpisode:
    """An episode with a clock and a scan, and programs of ROS beside it.

    Attributes:
        commands: What came for the robot so far.
    """

    def __init__(self, episode: Episode, folder: Path) -> None:
        self.graph, self._episode, self._folder = episode.graph, episode, folder
        self.commands: list[PlanarTwist] = []
        self._time_ns = 1_000_000_000
        for name in ("home", "log"):
            (folder / name).mkdir()
        self.environment = {
            "HOME": str(folder / "home"),
            "PATH": "/usr/bin:/bin",
            "PYTHONPATH": str(folder / "python"),
            "ROS_HOSTNAME": "127.0.0.1",
            "ROS_LOG_DIR": str(folder / "log"),
            "ROS_MASTER_URI": self.graph.uri,
            "ROS_PACKAGE_PATH": "/usr/share",
        }

    @contextmanager
    def started(self, *command: str) -> Generator[subprocess.Popen[str]]:
        """Runs a program until the end of the block."""
        with subprocess.Popen(
            command, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=self._folder
        ) as process:
            try:
                yield process
            finally:
                process.kill()

    def run(self, *command: str) -> Ended:
        """Runs a program to its end while time goes on."""
        with self.started(*command) as process:
            self.go_on(lambda: process.poll() is not None)
            assert process.stdout is not None
            return Ended(process.returncode, process.stdout.read())

    def run_all(self, commands: Sequence[Sequence[str]]) -> list[Ended]:
        """Runs programs at once."""
        processes = [
            subprocess.Popen(
                each,
                env=self.environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                cwd=self._folder,
            )
            for each in commands
        ]
        try:
            self.go_on(lambda: all(each.poll() is not None for each in processes))
        finally:
            for each in processes:
                each.kill()
        return [Ended(each.returncode, each.communicate()[0]) for each in processes]

    def go_on(self, done: Callable[[], bool]) -> None:
        """Lets simulated time go on until something is true."""
        ranges_m = np.ones(3)
        while not done():
            self._time_ns += _STEP_NS
            now = stamp(self._time_ns)
            self.graph.publish("/clock", ros_messages.clock(now))
            scan = ros_messages.laser_scan(
                1, now, "laser", ranges_m, angle_min=0.0, angle_increment=0.1, range_max=8.0, scan_s=0.02
            )
            self.graph.publish("/scan", scan)
            self._episode.loop.run_until_complete(asyncio.sleep(0.01))
            self.commands += [ros_messages.read_twist(data) for _, data in self.graph.take()]
        assert not self.graph.failure
