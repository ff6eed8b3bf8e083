"""ROS 2 as it is found on this machine: where, which release, its Python, the middleware that nodes speak.

It lies where ``AMENT_PREFIX_PATH`` says, or below ``/opt/ros``. That may be what Debian's packages or ``colcon`` made,
whose ``local_setup.sh`` says what programs see; or a virtual environment with the wheels of ROS 2, which has none.

Sources: ROS 2's design article "ament index"; ros_environment, which says the release; what the wheels set when a
Python begins, which is the same as here, and for which each Python starts a second time.
"""

import functools
import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from specs.errors import LaunchRefused
from tasks.ros.ros2.dds_domain import CYCLONE, FAST, MIDDLEWARES
from tasks.ros.ros2.steady_clock import NO_COMPILER, c_compiler

DISTRIBUTIONS, DEFAULT_DISTRIBUTION = ("humble", "iron", "jazzy", "kilted"), "jazzy"
"""The releases whose types the robot knows, the oldest first, and what it takes one to be that says nothing."""
ADD_TAGS_SERVICE, CANCEL_SERVICE = "/robomaker/job/add_tags", "/robomaker/job/cancel"

_OPT, _INDEX = Path("/opt/ros"), "share/ament_index"
_PYTHON = "/usr/bin/python3"
_SYSTEM = "/usr/bin:/bin:/usr/sbin:/sbin"
_SETUP, _SETUP_LIMIT_S = "local_setup.sh", 60.0
_PYTHONS = "lib/python3*/*-packages"
_RELEASE = "share/ros_environment/environment/1.ros_distro.sh"
_NAMED = re.compile(r"\bROS_DISTRO=\"?(\w+)")
_WHEEL = re.compile(r"ros_([a-z]+)_rclpy-")
# Its clients know answers by what packets carry beside the sample; Cyclone DDS's Python cannot set that.
_WITHHELD = f", so the robot offers no {ADD_TAGS_SERVICE} and no {CANCEL_SERVICE}"
# Variables that a shell sets by itself.
_OF_SHELL = frozenset({"PWD", "OLDPWD", "SHLVL", "_", "LANG"})


class Ros2Installation(NamedTuple):
    """ROS 2 as it is found here.

    Attributes:
        prefixes: Where packages are installed, the nearest first; empty without ROS 2.
        distribution: Such as ``jazzy``.
        python: What runs nodes in Python; only its name if it is not here.
        middleware: What nodes speak; empty if what the robot understands is not here.
        asked: The middleware that ``RMW_IMPLEMENTATION`` names.
        named: The release that ``ROS_DISTRO`` names, where another one is here.
    """

    prefixes: tuple[Path, ...]
    distribution: str
    python: str = _PYTHON
    middleware: str = CYCLONE
    asked: str = ""
    named: str = ""

    @property
    def here(self) -> bool:
        """Returns whether launch files run with ROS 2's own ``launch`` and ``launch_ros``."""
        return bool(self.python_paths("launch_ros"))

    @property
    def sentence(self) -> str:
        """Returns the same for a person."""
        if not self.prefixes:
            return "no ROS 2 with launch_ros: launch files run with Simyard's own stand-ins of launch and launch_ros"
        launch = "" if self.here else "; without launch_ros, so launch files run with Simyard's own stand-ins"
        other = f", not {self.asked}, which {self._why_not}" if self.asked not in {"", self.middleware} else ""
        middleware = f"; nodes speak {self.middleware}{other}" if self.middleware else ""
        withheld = _WITHHELD if self.middleware == FAST else ""
        untimed = f"; {NO_COMPILER}" if self.library("rclcpp") and not c_compiler() else ""
        found = f"ROS 2 {self.distribution} below {', '.join(map(str, self.prefixes))}"
        return f"{found}{middleware}{withheld}{launch}{untimed}"

    @property
    def _why_not(self) -> str:
        return "is not here" if self.asked in MIDDLEWARES else "the robot does not understand"

    @property
    def fault(self) -> str:
        """Returns why no node of it can drive a robot, and what to do; empty if one can."""
        where = ", ".join(map(str, self.prefixes))
        if self.prefixes and not any((each / _INDEX).is_dir() for each in self.prefixes):
            return f"AMENT_PREFIX_PATH names {where}, where no ROS 2 is (no {_INDEX}): name the folder that it is in"
        if not Path(self.python).is_absolute():
            return f"rclpy below {where} is for {self.python}, which is not here: install {self.python}"
        if self.named:
            return (
                f"ROS_DISTRO is {self.named!r}, and ROS 2 {self.distribution} is below {where}: "
                "unset it, or name that one's folder in AMENT_PREFIX_PATH"
            )
        if not self.middleware:
            packages = " or ".join(f"ros-{self.distribution}-{each.replace('_', '-')}" for each in MIDDLEWARES)
            here = f"ROS 2 {self.distribution} below {where}"
            return f"{here} has no middleware that the robot understands: install {packages}"
        return ""

    @property
    def fast_dds(self) -> int:
        """Returns the major version of Fast DDS."""
        return 3 if any(any(each.glob("lib/libfastdds.so.3*")) for each in self.prefixes) else 2

    def python_paths(self, module: str = "") -> list[str]:
        """Returns the folders of ROS 2's Python modules, or of those that have one."""
        found = [each for prefix in self.prefixes for each in sorted(prefix.glob(_PYTHONS))]
        return [str(each) for each in found if not module or (each / module).is_dir()]

    def library(self, name: str) -> bool:
        """Returns whether it has a library of C++."""
        return any((prefix / f"lib/lib{name}.so").is_file() for prefix in self.prefixes)

    def environment(self, spaces: Sequence[Path] = ()) -> dict[str, str]:
        """Returns what programs see: what the set-up files of its prefixes set, and those of a bundle's install spaces.

        Args:
            spaces: The bundle's, the nearest first.

        Raises:
            LaunchRefused: A set-up file fails.
        """
        own = {"ROS_VERSION": "2", "ROS_PYTHON_VERSION": "3", "ROS_DISTRO": self.distribution}
        found = {"PATH": _SYSTEM, **_set_up(tuple(each for each in self.prefixes if (each / _SETUP).is_file())), **own}
        # An install space was made in another folder than the one that it lies in now: its own set-up file is not run.
        bare = [each for each in (*spaces, *self.prefixes) if not (each in self.prefixes and (each / _SETUP).is_file())]
        wheels = [each for prefix in bare for each in sorted(prefix.glob(f"{_PYTHONS}/ros_*.libs"))]
        added = {
            "AMENT_PREFIX_PATH": bare,
            "LD_LIBRARY_PATH": [*(each / "lib" for each in bare), *wheels],
            "PYTHONPATH": [folder for each in bare for folder in sorted(each.glob(_PYTHONS))],
            "PATH": [each / "bin" for each in bare],
        }
        for name, folders in added.items():
            found[name] = joined_paths(map(str, folders), found.get(name, ""))
        if wheels:
            found["_ROS_WHEELS_BOOTSTRAP_COMPLETE"] = "1"
        return {name: value for name, value in found.items() if value}


def joined_paths(folders: Iterable[str], after: str = "") -> str:
    """Returns folders and a list of folders as one list, each folder once."""
    return ":".join(dict.fromkeys([*folders, *filter(None, after.split(":"))]))


@functools.cache
def _set_up(prefixes: tuple[Path, ...]) -> Mapping[str, str]:
    """Returns what the set-up files of prefixes set, the farthest run first."""
    if not prefixes:
        return {}
    sourced = "".join(f". {shlex.quote(str(each / _SETUP))} >&2 && " for each in reversed(prefixes))
    try:
        ran = subprocess.run(  # noqa: S603 - files of the ROS 2 that somebody installed here
            ["/bin/sh", "-c", f"{sourced}env -0"],
            env={"PATH": _SYSTEM, "LANG": "C.UTF-8"},
            capture_output=True,
            timeout=_SETUP_LIMIT_S,
            check=True,
        )
    except subprocess.SubprocessError as exc:
        said = getattr(exc, "stderr", None) or b""
        why = said.decode(errors="replace").strip().rpartition("\n")[2][:300] or str(exc)
        raise LaunchRefused(f"the {_SETUP} of {', '.join(map(str, prefixes))} fails: {why}") from exc
    pairs = (each.partition("=") for each in ran.stdout.decode(errors="replace").split("\0"))
    return {name: value for name, _, value in pairs if name and name not in _OF_SHELL}


def ros2_installation(variables: Mapping[str, str] | None = None) -> Ros2Installation:
    """Returns the ROS 2 of this machine: that of ``AMENT_PREFIX_PATH``, or the newest known below ``/opt/ros``.

    Args:
        variables: Where ``AMENT_PREFIX_PATH``, ``ROS_DISTRO`` and ``RMW_IMPLEMENTATION`` are looked up; this process's
            own by default.
    """
    given = os.environ if variables is None else variables
    named, asked = given.get("ROS_DISTRO", ""), given.get("RMW_IMPLEMENTATION", "")
    prefixes = tuple(Path(each) for each in given.get("AMENT_PREFIX_PATH", "").split(":") if each)
    if not prefixes:
        names = [named, *reversed(DISTRIBUTIONS)] if named in DISTRIBUTIONS else reversed(DISTRIBUTIONS)
        here = (_OPT / name for name in names if (_OPT / name / _INDEX).is_dir())
        prefixes = tuple(each for each in [next(here, None)] if each is not None)
    if not prefixes:
        return Ros2Installation((), named if named in DISTRIBUTIONS else DEFAULT_DISTRIBUTION)
    told = _release(prefixes)
    distribution = told or (named if named in DISTRIBUTIONS else DEFAULT_DISTRIBUTION)
    other = named if named not in {"", distribution} else ""
    return Ros2Installation(prefixes, distribution, _python(prefixes), _middleware(prefixes, asked), asked, other)


def _release(prefixes: Iterable[Path]) -> str:
    """Returns which release prefixes say that they are; empty if none says one that is known."""
    for prefix in prefixes:
        path = prefix / _RELEASE
        names = _NAMED.findall(path.read_text(errors="replace")) if path.is_file() else [prefix.name]
        names += [each[1] for path in prefix.glob(f"{_PYTHONS}/ros_*_rclpy-*") if (each := _WHEEL.match(path.name))]
        if found := next((name for name in names if name in DISTRIBUTIONS), ""):
            return found
    return ""


def _python(prefixes: Iterable[Path]) -> str:
    """Returns the Python that rclpy is made for: that of its own prefix, else the system's of the same version."""
    for prefix in prefixes:
        for modules in sorted(prefix.glob(f"{_PYTHONS}/rclpy")):
            own, version = prefix / "bin/python3", modules.parents[1].name
            return str(own) if os.access(own, os.X_OK) else shutil.which(version, path=_SYSTEM) or version
    return _PYTHON


def _middleware(prefixes: Iterable[Path], asked: str) -> str:
    """Returns the middleware that nodes speak: the one that is asked for if it is here, else the better one that is."""
    have = [each for each in MIDDLEWARES if any((prefix / f"lib/lib{each}.so").is_file() for prefix in prefixes)]
    return asked if asked in have else next(iter(have), "")
