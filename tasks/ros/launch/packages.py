"""Where ROS 1 is on this machine, and which packages a bundle and ROS bring: their folders and executables.

Gazebo is never here: packages stand in for its own, so that roslaunch resolves launch files that include them. What
they call their nodes and arguments is what their public documentation says.
"""

import functools
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Literal, NamedTuple, NoReturn
from xml.etree import ElementTree

from specs.errors import LaunchRefused

ROS_PYTHON = "SIMYARD_ROS_PYTHON"
_PROBE_S = 300.0  # ends a hang: a busy machine took half a minute
_DEBIAN_ROS = "python3-roslaunch python3-rospy python3-roslib ros-core"
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
        tried.append(_probe_installation(Path(chosen) if chosen else Path("/usr/bin/python3"), prefix))
        if not tried[-1].missing:
            return tried[-1]
    return tried[-1]


def _prefixes(ros_root: str) -> list[Path]:
    """Returns where ROS may lie; Debian's below /usr is always the last."""
    own = Path(ros_root).parent.parent if ros_root else None
    places = [own, Path("/opt/ros/noetic"), Path("/usr")]
    return list(dict.fromkeys(place for place in places if place and (place == Path("/usr") or place.is_dir())))


def _probe_installation(python: Path, prefix: Path) -> RosInstallation:
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
        remedy = f"install ROS 1 Noetic (Debian 12: apt-get install {_DEBIAN_ROS}) or set {ROS_PYTHON}"
        return installation._replace(missing=f"ROS 1 is not there for {python}: {why}; {remedy}")
    return installation._replace(version=json.loads(done.stdout)["version"])


_NEEDS = ("exec_depend", "run_depend", "depend")
_VERSION = re.compile(r"\s*\$ROS_VERSION\s*(?P<sign>[!=]=)\s*['\"]?(?P<version>\d)['\"]?\s*")
_DEBIAN_INFO = Path("/var/lib/dpkg/info")
_DEPTH = 6
_MOST_BYTES = 1 << 20
# Of packages of ROS and of the system (REP 127, Debian policy 5.6.1): no pattern of files, and no way to a folder.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]*")
# Debian splits what ROS has in one package, has few under ROS's name, and most not at all.
_DEBIAN_PACKAGES = {
    "roscpp": "libroscpp-dev",
    "topic_tools": "libtopic-tools-dev",
    "tf": "python3-tf",
    "roslaunch": "python3-roslaunch",
    "rospy": "python3-rospy",
    "rosbag": "python3-rosbag",
    "dynamic_reconfigure": "python3-dynamic-reconfigure",
    "actionlib": "python3-actionlib",
    "tf2_ros": "python3-tf2-ros",
    "cv_bridge": "python3-cv-bridge",
    "xacro": "xacro",
}
_UNDER_ROS_NAME = frozenset(
    {"camera_calibration", "image_proc", "image_publisher", "image_rotate", "image_view", "message_generation"}
) | frozenset({"message_runtime", "opencv_apps", "robot_state_publisher", "stereo_image_proc"})


class MissingPackage(NamedTuple):
    """A package that another one needs.

    Attributes:
        name: As package.xml has it.
        needed_by: The package that needs it.
        debian: What probably brings it; empty where that is not known.
    """

    name: str
    needed_by: str
    debian: str

    @property
    def sentence(self) -> str:
        """Returns the same for a person."""
        remedy = f"try apt-get install {self.debian}" if self.debian else "install it, or put it into the bundle"
        return f"the ROS package {self.name}, which {self.needed_by} needs, is missing: {remedy}"


def missing_packages(bundle: Path, package: str) -> list[MissingPackage]:
    """Returns what a package of a bundle needs when it runs, itself or through others of the bundle, and is not here.

    Args:
        bundle: Folder that holds the ROS packages.
        package: The one that is launched.

    Raises:
        LaunchRefused: The bundle does not have the package, or a package.xml cannot be read.
    """
    installation, own = ros_installation(), bundle_packages(bundle)
    if package not in own and not _installed(installation, package):
        have = ", ".join(sorted(own)) or "no package at all"
        raise LaunchRefused(f"there is no ROS package {package!r} in the bundle, which has {have}")
    todo, seen, missing = [package], {package}, list[MissingPackage]()
    while todo:
        needer = todo.pop()
        for name in runtime_needs(own[needer] / "package.xml", "1") if needer in own else ():
            if name in seen:
                continue
            seen.add(name)
            todo.append(name)
            stands = name in GAZEBO_PACKAGES or (name == "xacro" and has_xacro())
            if name not in own and not stands and not _installed(installation, name):
                missing.append(MissingPackage(name, needer, _debian_name(installation, name)))
    return sorted(missing)


GAZEBO_PACKAGES = frozenset(
    {"gazebo", "gazebo_msgs", "gazebo_plugins", "gazebo_ros", "gazebo_ros_control"}
) | frozenset({"rviz", "rqt_gui", "joint_state_publisher"})
"""What Simyard stands for: its own engines and the windows of a person are nobody's to install."""


STAND_INS = "simyard-stand-ins"
"""A folder that programs of ROS 2 lie in which do nothing: by it they are known."""


def has_xacro() -> bool:
    """Returns whether Simyard's own Python has xacro."""
    return find_spec("xacro") is not None


_GAZEBO_NODES = ("gazebo", "gzserver", "gzclient", "debug", "gdbrun", "perf", "spawn_model")
_NODES = {
    "gazebo_ros": _GAZEBO_NODES,
    "rviz": ("rviz",),
    "rqt_gui": ("rqt_gui",),
    "joint_state_publisher": ("joint_state_publisher", "joint_state_publisher_gui"),
}
_EMPTY_WORLD = """<launch>
  <arg name="paused" default="false"/>
  <arg name="use_sim_time" default="true"/>
  <arg name="extra_gazebo_args" default=""/>
  <arg name="gui" default="true"/>
  <arg name="recording" default="false"/>
  <arg name="headless" default="false"/>
  <arg name="debug" default="false"/>
  <arg name="physics" default="ode"/>
  <arg name="verbose" default="false"/>
  <arg name="output" default="screen"/>
  <arg name="world_name" default="worlds/empty.world"/>
  <arg name="respawn_gazebo" default="false"/>
  <arg name="use_clock_frequency" default="false"/>
  <arg name="pub_clock_frequency" default="100"/>
  <arg name="enable_ros_network" default="true"/>
  <arg name="server_required" default="false"/>
  <arg name="gui_required" default="false"/>
  <param name="/use_sim_time" value="$(arg use_sim_time)"/>
  <node name="gazebo" pkg="gazebo_ros" type="gzserver"
    args="$(arg extra_gazebo_args) -e $(arg physics) $(arg world_name)"/>
  <node if="$(arg gui)" name="gazebo_gui" pkg="gazebo_ros" type="gzclient"/>
</launch>
"""


_XACRO = """
import os, sys, types
from pathlib import Path

def share(name):
    roots = [Path(each) for each in os.environ["ROS_PACKAGE_PATH"].split(":")]
    near = [each / name for each in roots if (each / name / "package.xml").is_file()]
    named = "<name>%s</name>" % name
    inside = [each.parent for each in sorted(roots[0].rglob("package.xml")) if named in each.read_text()]
    if not near + inside:
        raise KeyError("there is no ROS package %r in the bundle or in ROS" % name)
    return str((inside + near)[0])

index = types.ModuleType("ament_index_python.packages")
index.get_package_share_directory = share
sys.modules["ament_index_python"] = types.ModuleType("ament_index_python")
sys.modules["ament_index_python.packages"] = index
import xacro
xacro.main()
"""


def make_gazebo_packages(folder: Path) -> Path:
    """Makes the packages that stand in for Gazebo's own, and returns the folder that they are in.

    A node of theirs does nothing: it has a name, by which it is known what it would have done. Where Simyard has xacro,
    it stands in for ROS's, which is looked for before.
    """
    for name in sorted(GAZEBO_PACKAGES):
        package = folder / name
        package.mkdir(parents=True)
        (package / "package.xml").write_text(f"<package><name>{name}</name><version>0.0.0</version></package>")
        for node in _NODES.get(name, ()):
            write_program(package / node)
    if has_xacro():
        make_xacro(folder / "xacro")
        (folder / "xacro/package.xml").write_text("<package><name>xacro</name><version>2.0.0</version></package>")
    launch = folder / "gazebo_ros/launch"
    launch.mkdir()
    (launch / "empty_world.launch").write_text(_EMPTY_WORLD)
    return folder


def make_xacro(folder: Path) -> None:
    """Makes a folder with the program ``xacro``, which finds packages by ``ROS_PACKAGE_PATH``."""
    folder.mkdir(parents=True)
    (folder / "program.py").write_text(_XACRO)
    command = shlex.join([sys.executable, "-I", str(folder / "program.py")])
    for name in ("xacro", "xacro.py"):
        write_program(folder / name, f'#!/bin/sh\nexec {command} "$@"\n')


def write_program(path: Path, text: str = "#!/bin/sh\n") -> None:
    """Writes a file that can be executed from the first: behind a wall of its own no process may change a mode."""
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o755), "w") as file:
        file.write(text)


def bundle_packages(bundle: Path) -> dict[str, Path]:
    """Returns the folders of a bundle's ROS packages by name."""
    return {read_manifest(path).findtext("name", path.parent.name).strip(): path.parent for path in _manifests(bundle)}


def read_manifest(path: Path) -> ElementTree.Element:
    """Returns what a package.xml says.

    Args:
        path: The file, which a stranger may have written.

    Raises:
        LaunchRefused: It is no XML, larger than any package.xml, or has a document type, which entities need.
    """
    with path.open("rb") as file:
        data = file.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise LaunchRefused(f"{path}: more than {_MOST_BYTES} bytes")
    return plain_xml(data, str(path), "package.xml")


def plain_xml(data: bytes, name: str, what: str) -> ElementTree.Element:
    """Returns the outermost element of a stranger's XML.

    Args:
        data: The text.
        name: What a person calls it.
        what: What it shall be.

    Raises:
        LaunchRefused: It is no XML, or has a document type, which entities need.
    """
    try:
        return ElementTree.fromstring(data, ElementTree.XMLParser(target=_Tree(what)))  # noqa: S314 - without entities
    except (ElementTree.ParseError, LookupError, ValueError) as exc:
        raise LaunchRefused(f"{name}: not a {what}: {exc}") from exc
    except LaunchRefused as exc:
        raise LaunchRefused(f"{name}: {exc}") from None


class _Tree(ElementTree.TreeBuilder):
    """Builds a document's tree, and none of one that could have entities, in whatever encoding."""

    def __init__(self, what: str) -> None:
        super().__init__()
        self._what = what

    def doctype(self, *_: object) -> NoReturn:
        raise LaunchRefused(f"a {self._what} has no document type, and no entities")


def _manifests(bundle: Path) -> Iterator[Path]:
    """Yields the package.xml of each package; none lies inside another one."""
    todo = [(bundle, 0)]
    while todo:
        folder, depth = todo.pop()
        if (folder / "package.xml").is_file():
            yield folder / "package.xml"
        elif depth < _DEPTH:
            todo += [(each, depth + 1) for each in sorted(folder.iterdir()) if each.is_dir() and not each.is_symlink()]


def runtime_needs(path: Path, ros: Literal["1", "2"]) -> list[str]:
    """Returns what a package needs when it runs with ROS 1 or ROS 2.

    Args:
        path: Its package.xml.
        ros: The version. What has a condition on something else is needed (REP 149).

    Raises:
        LaunchRefused: It cannot be read, or what it needs has no name of a package.
    """
    root = read_manifest(path)
    needed = (each for kind in _NEEDS for each in root.findall(kind) if not _is_of_another(each, ros))
    found = [each.text.strip() for each in needed if each.text]
    for name in found:
        if not _NAME.fullmatch(name):
            raise LaunchRefused(f"{path}: {name[:80]!r} is no name of a package")
    return list(dict.fromkeys(found))


def _is_of_another(needed: ElementTree.Element, ros: Literal["1", "2"]) -> bool:
    condition = _VERSION.fullmatch(needed.get("condition", ""))
    return condition is not None and (condition["version"] == ros) != (condition["sign"] == "==")


def _installed(installation: RosInstallation, name: str) -> bool:
    """Returns whether ROS, or the system for a name that is none of ROS's, has a package."""
    if (installation.prefix / "share" / name / "package.xml").is_file():
        return True
    return any(_DEBIAN_INFO.glob(f"{name}.list")) or any(_DEBIAN_INFO.glob(f"{name}:*.list"))


def _debian_name(installation: RosInstallation, name: str) -> str:
    dashed = name.replace("_", "-")
    if installation.prefix != Path("/usr"):
        return f"ros-{installation.distribution}-{dashed}"
    if name.endswith(("_msgs", "_srvs")):
        return _DEBIAN_PACKAGES.get(name, f"python3-{dashed}")
    if dashed.startswith(("python3-", "lib")):
        return dashed
    return _DEBIAN_PACKAGES.get(name, f"ros-{dashed}" if name in _UNDER_ROS_NAME else "")
