"""Which ROS 2 there is on this machine: its folders, its distribution, its Python."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from tasks.ros.ros2.interface_types import DEFAULT_DISTRIBUTION, DISTRIBUTIONS

_OPT = Path("/opt/ros")
_PYTHON = "/usr/bin/python3"


class Ros2Installation(NamedTuple):
    """ROS 2 as it is found here.

    Attributes:
        prefixes: Where packages are installed, the nearest first; empty without ROS 2.
        distribution: Such as ``jazzy``.
        python: What runs nodes in Python; with ROS 2 the system's.
    """

    prefixes: tuple[Path, ...]
    distribution: str
    python: str = _PYTHON

    @property
    def here(self) -> bool:
        """Returns whether launch files run with ROS 2's own ``launch`` and ``launch_ros``."""
        return bool(self.python_paths("launch_ros"))

    @property
    def sentence(self) -> str:
        """Returns the same for a person."""
        if not self.here:
            return "no ROS 2 with launch_ros: launch files run with Simyard's own stand-ins of launch and launch_ros"
        return f"ROS 2 {self.distribution} below {', '.join(map(str, self.prefixes))}"

    def python_paths(self, module: str = "") -> list[str]:
        """Returns the folders of ROS 2's Python modules, or of those that have one."""
        found = [each for prefix in self.prefixes for each in sorted(prefix.glob("lib/python3*/*-packages"))]
        return [str(each) for each in found if not module or (each / module).is_dir()]

    def environment(self) -> dict[str, str]:
        """Returns what ROS 2's own set-up files would set, as far as programs need it."""
        own = {
            "PATH": ":".join([*(f"{each}/bin" for each in self.prefixes), "/usr/bin:/bin:/usr/sbin:/sbin"]),
            "ROS_VERSION": "2",
            "ROS_PYTHON_VERSION": "3",
            "ROS_DISTRO": self.distribution,
        }
        if self.prefixes:
            own["AMENT_PREFIX_PATH"] = ":".join(map(str, self.prefixes))
            own["LD_LIBRARY_PATH"] = ":".join(f"{each}/lib" for each in self.prefixes)
            own["PYTHONPATH"] = ":".join(self.python_paths())
        return own


def ros2_installation(variables: Mapping[str, str] | None = None) -> Ros2Installation:
    """Returns the ROS 2 of this machine: that of ``AMENT_PREFIX_PATH``, or the newest known below ``/opt/ros``.

    Args:
        variables: Where ``AMENT_PREFIX_PATH`` and ``ROS_DISTRO`` are looked up; this process's own by default.
    """
    given = os.environ if variables is None else variables
    prefixes = [Path(each) for each in given.get("AMENT_PREFIX_PATH", "").split(":") if each]
    named = given.get("ROS_DISTRO", "")
    if prefixes:
        return Ros2Installation(tuple(prefixes), named if named in DISTRIBUTIONS else DEFAULT_DISTRIBUTION)
    for name in reversed(DISTRIBUTIONS):
        if (_OPT / name / "share/ament_index").is_dir():
            return Ros2Installation((_OPT / name,), name)
    return Ros2Installation((), named if named in DISTRIBUTIONS else DEFAULT_DISTRIBUTION)
