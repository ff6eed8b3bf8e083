"""What a deployment runs on the robot: three scripts, and a process that lives until it is told to stop."""

import os
import signal
import subprocess
from pathlib import Path

import pytest

from tests.factories.simulations import COURIER, FOLDERS
from tests.servers.eventually import eventually

SCRIPTS = FOLDERS[COURIER] / "courier"


def run(script: str, folder: Path, speed: str = "0.5") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(SCRIPTS / script)],
        cwd=folder,
        env={**os.environ, "MAX_SPEED": speed},
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_courier_shows_a_heartbeat_until_it_is_told_to_stop(tmp_path: Path):
    heartbeat = tmp_path / "heartbeat"
    with subprocess.Popen([str(SCRIPTS / "run.sh")], cwd=tmp_path, stdout=subprocess.DEVNULL) as process:
        try:
            eventually(heartbeat.exists)
            first = heartbeat.read_text()
            eventually(lambda: heartbeat.read_text() > first)
            assert run("post_launch.sh", tmp_path).returncode == 0
            assert process.poll() is None
        finally:
            process.send_signal(signal.SIGTERM)
        assert process.wait() == 0
    assert not heartbeat.exists()


@pytest.mark.parametrize(("speed", "code"), [("0.5", 0), ("1", 0), ("fast", 1), ("1.2.3", 1), ("", 0), (".", 1)])
def test_a_speed_limit_that_makes_no_sense_stops_the_launch(tmp_path: Path, speed: str, code: int):
    assert run("pre_launch.sh", tmp_path, speed).returncode == code


def test_a_heartbeat_of_an_earlier_launch_does_not_count(tmp_path: Path):
    (tmp_path / "heartbeat").write_text("1\n")
    assert run("pre_launch.sh", tmp_path).returncode == 0
    assert not (tmp_path / "heartbeat").exists()
