"""ROS 1's own tools take the bags: `rosbag info`, `check`, `filter` and `play`, which a node hears."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tasks.ros.bag.bag_file import write_rosbag
from tests.ros.bag.tracks import SAMPLES, log
from tests.servers.ports import free_port

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not (shutil.which("rosbag") or os.environ.get("CI") == "true"), reason="ROS 1 is not here"),
]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tools") / "episode.bag"
    write_rosbag(path, log())
    return path


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """The environment of programs of ROS that have a master of their own."""
    port = free_port()
    home = tmp_path_factory.mktemp("ros")
    found = {"PATH": "/usr/bin:/bin", "ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
    found |= {"HOME": str(home), "ROS_HOME": str(home)}
    master = subprocess.Popen(["rosmaster", "--core", "-p", str(port)], env=found, stdout=subprocess.DEVNULL)
    yield found
    master.terminate()
    master.wait()


def told(*command: str, environment: dict[str, str] | None = None) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_info_tells_each_topic_with_its_count_and_type(bag: Path):
    out = told("rosbag", "info", str(bag))
    assert re.search(r"duration: +2\.0s", out)
    assert re.search(r"compression: +lz4", out)
    for topic, count, kind in (
        ("/odom", SAMPLES, "nav_msgs/Odometry"),
        ("/scan", SAMPLES - 1, "sensor_msgs/LaserScan"),
        ("/map", 1, "nav_msgs/OccupancyGrid"),
    ):
        assert re.search(rf"{topic} +{count} msgs? +: {kind}", out), out


def test_check_finds_that_this_machines_messages_are_those_of_the_bag(bag: Path):
    out = told("rosbag", "check", str(bag))
    changes = re.findall(r"From: +(\S+) \[(\w+)\]\n +To: +(\S+) \[(\w+)\]", out)
    assert all(change[:2] == change[2:] for change in changes), out
    assert "Missing" not in out


def test_filter_decompresses_and_reads_every_message(bag: Path, tmp_path: Path):
    told("rosbag", "filter", str(bag), str(tmp_path / "scans.bag"), "topic == '/scan' and len(m.ranges) == 5")
    assert f"/scan   {SAMPLES - 1} msgs" in told("rosbag", "info", str(tmp_path / "scans.bag"))


def test_play_sends_what_was_written_to_a_node_that_listens(bag: Path, environment: dict[str, str]):
    # On a busy machine rostopic may come too late for rosbag, which then waits for ever.
    heard = (_heard(bag, environment, 10.0 * 2**attempt) for attempt in range(6))
    assert next((each for each in heard if each), []) == [0, 1, 2]


def _heard(bag: Path, environment: dict[str, str], patience_s: float) -> list[int]:
    listen = ["rostopic", "echo", "-n", "3", "--noarr", "/odom/header/seq"]
    play = ["rosbag", "play", "--quiet", "--wait-for-subscribers", str(bag), "--topics", "/odom"]
    with (
        subprocess.Popen(listen, env=environment, stdout=subprocess.PIPE, text=True) as echo,
        subprocess.Popen(play, env=environment, start_new_session=True) as player,
    ):
        try:
            assert player.wait(patience_s) == 0
            out, _ = echo.communicate(timeout=patience_s)
        except subprocess.TimeoutExpired:
            return []
        finally:
            echo.kill()
            # rosbag starts a program that would outlive it, and then play to the listener of the next attempt as well.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(player.pid, signal.SIGKILL)
    return [int(each) for each in re.findall(r"\d+", out)]
