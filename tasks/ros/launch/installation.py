"""Which ROS 1 there is on this machine: its Python, its packages, its distribution."""

import functools
import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

ROS_PYTHON = "SIMYARD_ROS_PYTHON"
_PROBE_S = 30.0
_DEBIAN = "python3-roslaunch python3-rospy python3-roslib ros-core"
# Runs in a Python that may be ROS's own.
_PROBE = """
import json, sys
import rosgraph, roslaunch, roslib, rospkg
version = rospkg.RosPack(rospkg.get_ros_paths()).get_manifest("roslaunch").version
print(json.dumps({"python": sys.version.split()[0], "version": version}))
"""


class RosInstallation(NamedTuple):
    """ROS 1 as it is found here.

    Attributes:
        python: ROS's own Python, which is seldom Simyard's.
        prefix: Where ROS lies: ``/opt/ros/noetic``, or ``/usr`` for Debian's.
        distribution: Such as ``noetic``.
        version: Of roslaunch.
        missing: Why ROS cannot be used, and what to do; empty where it can.
    """

    python: Path
    prefix: Path
    distribution: str
    version: str
    missing: str = ""

    @property
    def sentence(self) -> str:
        """Returns the same for a person."""
        if self.missing:
            return self.missing
        return f"ROS 1 {self.distribution} below {self.prefix} (roslaunch {self.version}, {self.python})"

    def environment(self) -> dict[str, str]:
        """Returns what ROS's own set-up files would set, as far as programs need it."""
        own = {
            "PATH": f"{self.prefix}/bin:/usr/bin:/bin:/usr/sbin:/sbin",
            "ROS_PACKAGE_PATH": str(self.prefix / "share"),
            "ROS_DISTRO": self.distribution,
            "ROS_VERSION": "1",
            "ROS_PYTHON_VERSION": "3",
            "PYTHONPATH": "",
        }
        if self.prefix != Path("/usr"):
            own["ROS_ROOT"] = str(self.prefix / "share/ros")
            own["ROS_ETC_DIR"] = str(self.prefix / "etc/ros")
            own["CMAKE_PREFIX_PATH"] = str(self.prefix)
            own["LD_LIBRARY_PATH"] = str(self.prefix / "lib")
            own["PYTHONPATH"] = str(self.prefix / "lib/python3/dist-packages")
        return own


def ros_installation() -> RosInstallation:
    """Returns the ROS 1 of this machine, or why there is none.

    ``SIMYARD_ROS_PYTHON`` names the Python to use; else ``ROS_ROOT``, ``/opt/ros/noetic`` and Debian's own packages
    below ``/usr`` are tried in this order.
    """
    return _found(os.environ.get(ROS_PYTHON, ""), os.environ.get("ROS_ROOT", ""))


@functools.cache
def _found(chosen: str, ros_root: str) -> RosInstallation:
    tried: list[RosInstallation] = []
    for prefix in _prefixes(ros_root):
        tried.append(_asked(Path(chosen) if chosen else Path("/usr/bin/python3"), prefix))
        if not tried[-1].missing:
            return tried[-1]
    return tried[-1]


def _prefixes(ros_root: str) -> list[Path]:
    """Returns where ROS may lie; Debian's below /usr is always the last."""
    own = Path(ros_root).parent.parent if ros_root else None
    places = [own, Path("/opt/ros/noetic"), Path("/usr")]
    return list(dict.fromkeys(place for place in places if place and (place == Path("/usr") or place.is_dir())))


def _asked(python: Path, prefix: Path) -> RosInstallation:
    """Returns what a Python says of the ROS below a folder."""
    installation = RosInstallation(python, prefix, "noetic", "")
    program = shutil.which(str(python))
    if program is None:
        return installation._replace(
            missing=f"{python} is not there: set {ROS_PYTHON} to the Python that has roslaunch"
        )
    environment = {**installation.environment(), "LANG": "C.UTF-8", "HOME": "/nonexistent"}
    try:
        done = subprocess.run(  # noqa: S603 - a Python that the machine's owner chose
            [program, "-c", _PROBE], env=environment, capture_output=True, text=True, timeout=_PROBE_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as exc:
        return installation._replace(missing=f"{python} does not answer: {exc}")
    if done.returncode:
        why = (done.stderr.strip().splitlines() or ["it says nothing"])[-1]
        remedy = f"install ROS 1 Noetic (Debian 12: apt-get install {_DEBIAN}) or set {ROS_PYTHON}"
        return installation._replace(missing=f"ROS 1 is not there for {python}: {why}; {remedy}")
    return installation._replace(version=json.loads(done.stdout)["version"])
