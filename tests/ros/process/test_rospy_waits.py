"""rospy's waits in simulated time, as far as one Python shows them."""

import os
import subprocess
from pathlib import Path

import pytest

from tasks.ros.launch.packages import RosInstallation
from tasks.ros.process.rospy_waits import with_simulated_waits

_BEGUN = """
import threading, time, rospy
from rospy import rostime
wait = rospy.client.time
rostime.set_rostime_initialized(True)
"""


@pytest.fixture
def folder(ros: RosInstallation, tmp_path: Path) -> Path:
    """Of a user's modules, which a node has beside."""
    (tmp_path / "user").mkdir()
    return tmp_path / "user"


def told(ros: RosInstallation, folder: Path, program: str) -> str:
    python_path = with_simulated_waits(folder.parent, f"{folder}:{ros.environment()['PYTHONPATH']}")
    environment = {**os.environ, **ros.environment(), "PYTHONPATH": python_path}
    done = subprocess.run([ros.python, "-c", program], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("module", ["rospy.client", "rospy.impl.tcpros_service"])
def test_seconds_are_simulated_once_simulated_time_has_come(ros: RosInstallation, folder: Path, module: str) -> None:
    waits = f"""{_BEGUN}
import sys
wait = sys.modules["{module}"].time
before = wait.time() > 1e9
rostime._set_rostime(rospy.Time(0))
threading.Timer(0.3, lambda: rostime._set_rostime(rospy.Time(7, 500000000))).start()
print(before, wait.time(), rospy.rostime.time is time)
"""
    assert told(ros, folder, waits) == "True 7.5 True\n"


def test_who_sleeps_until_the_next_look_sleeps_in_simulated_time(ros: RosInstallation, folder: Path) -> None:
    """Before the first tick services come while time stands, so it looks again by the wall's clock."""
    sleeps = f"""{_BEGUN}
rostime._set_rostime(rospy.Time(1))
wait.sleep(0.01)
rostime._set_rostime(rospy.Time(2))
sleeper = threading.Thread(target=wait.sleep, args=(0.3,), daemon=True)
sleeper.start()
sleeper.join(0.6)
rostime._set_rostime(rospy.Time(2, 200000000))
sleeper.join(0.3)
asleep = sleeper.is_alive()
rostime._set_rostime(rospy.Time(2, 300000000))
sleeper.join(30.0)
print(asleep, sleeper.is_alive())
"""
    assert told(ros, folder, sleeps) == "True False\n"


def test_a_users_own_sitecustomize_is_run_as_without(ros: RosInstallation, folder: Path) -> None:
    (folder / "sitecustomize.py").write_text("print('mine', __name__)\nVALUE = 3\n")
    assert told(ros, folder, "import sitecustomize; print(sitecustomize.VALUE)") == "mine sitecustomize\n3\n"
