"""The command that launches a ROS launch file on a robot, with the ROS that the robot has.

What an episode launches node by node, a robot launches by roslaunch or ``ros2 launch``: the same file of the same
bundle, found in the same way. Robots have any distribution of ROS, so that its own set-up file says where it lies.
"""

import shlex
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from specs.errors import LaunchRefused
from specs.launched_file import bundle_files, is_ros2, ros_launch_file, workspace_variables

OWN_VARIABLES = (
    "ROS_MASTER_URI",
    "ROS_IP",
    "ROS_HOSTNAME",
    "ROS_DISTRO",
    "ROS_DOMAIN_ID",
    "RMW_IMPLEMENTATION",
    "AMENT_PREFIX_PATH",
)
"""What a robot's owner sets for the agent, and applications of ROS get, too: where the network and ROS 2 are."""
_STAND_IN = "tasks.ros.ros2.launch_file.robot_launch"
_ROS_FOLDER = Path("/opt/ros")
_COLCON_MARK = "_local_setup_util_sh.py"
_PROGRAMS_PATH = "/usr/local/bin:/usr/bin:/bin"


class RobotRos(NamedTuple):
    """The ROS of a robot.

    Attributes:
        program: ``roslaunch`` or ``ros2``, with its folder; this Python where Simyard launches in place of ``ros2``.
        setup: The file that sets its environment; None where ROS lies among the system's programs.
        bare: Whether there is no ``ros2``, as in ROS 2's wheels.
    """

    program: Path
    setup: Path | None = None
    bare: bool = False


def robot_ros(launch_file: str, distribution: str = "", folder: Path = _ROS_FOLDER, prefixes: str = "") -> RobotRos:
    """Returns the ROS of this machine that launches a file.

    Args:
        launch_file: Its ending tells ROS 1 from ROS 2.
        distribution: Such as ``noetic``; empty for the newest that is here.
        folder: Where distributions lie, one folder each.
        prefixes: ``AMENT_PREFIX_PATH``, of a robot's owner.

    Raises:
        LaunchRefused: There is none; says what was looked for.
    """
    name = "ros2" if is_ros2(launch_file) else "roslaunch"
    for home in sorted(folder.iterdir() if folder.is_dir() else (), reverse=True):
        if distribution in {"", home.name} and (home / "bin" / name).is_file() and (home / "setup.sh").is_file():
            return RobotRos(home / "bin" / name, home / "setup.sh")
    if found := shutil.which(name, path=_PROGRAMS_PATH):
        return RobotRos(Path(found))
    if name == "ros2" and prefixes:
        programs = [Path(each, "bin", name) for each in prefixes.split(":")]
        found = next((each for each in programs if each.is_file()), None)
        return RobotRos(found or Path(sys.executable), bare=found is None)
    asked = f"ROS {2 if is_ros2(launch_file) else 1}{f' {distribution}' if distribution else ''}"
    raise LaunchRefused(
        f"{launch_file} needs {asked}, and this robot has no {name} in {folder}/{distribution or '*'}/bin or on "
        f"{_PROGRAMS_PATH}: install it, with the packages that the application needs"
    )


def launch_command(ros: RobotRos, bundle: Path, package: str, launch_file: str) -> list[str]:
    """Returns the command that launches a file of a bundle, and ends with it.

    Args:
        ros: The robot's.
        bundle: Where it is unpacked.
        package: The launch configuration's packageName.
        launch_file: Its launchFile.

    Raises:
        LaunchRefused: The bundle has no such launch file.
    """
    files = bundle_files(bundle)
    found = ros_launch_file(files, package, launch_file)
    if found is None:
        raise LaunchRefused(f"the bundle has no launch file {launch_file} in a package {package}")
    if ros.bare:
        return [str(ros.program), "-P", "-m", _STAND_IN, str(bundle), package, launch_file]
    lines = [f". {shlex.quote(str(ros.setup))}"] if ros.setup else []
    if is_ros2(launch_file):
        spaces = [(bundle / name).parent for name in files if name.endswith(f"/{_COLCON_MARK}")]
        lines += [_colcon_setup(space / "local_setup.sh") for space in spaces]
    else:
        lines += [_export(name, value) for name, value in workspace_variables(bundle, files, {}).items()]
    program = f"{shlex.quote(str(ros.program))}{' launch' if is_ros2(launch_file) else ''}"
    return ["/bin/sh", "-c", "\n".join([*lines, f"exec {program} {shlex.quote(str(bundle / found))}"])]


def launch_sentence(package: str, launch_file: str) -> str:
    """Returns what a robot runs for a launch file, for a person."""
    if is_ros2(launch_file):
        return f"ros2 launch, on {launch_file} of {package} in the bundle"
    return f"roslaunch {package} {launch_file}, with the bundle first in ROS_PACKAGE_PATH"


def make_python(folder: Path) -> Path:
    """Makes a folder with a ``python``, and returns it: scripts from before Noetic ask for it, and no system has it.

    It stands last in PATH, so that a robot's own ``python`` is found before.
    """
    folder.mkdir(exist_ok=True)
    link = folder / "python"
    if not link.is_symlink():
        link.symlink_to("/usr/bin/python3")
    return folder


def own_variables(environment: Mapping[str, str]) -> dict[str, str]:
    """Returns the variables of a robot's agent that its ROS applications get."""
    return {name: environment[name] for name in OWN_VARIABLES if name in environment}


def _export(name: str, value: str) -> str:
    # Debian's ROS, which has no set-up file, looks for packages there if nobody says otherwise.
    after = f":${{{name}:-/usr/share}}" if name == "ROS_PACKAGE_PATH" else f"${{{name}:+:${name}}}"
    return f"export {name}={shlex.quote(value)}{after}"


def _colcon_setup(path: Path) -> str:
    return f"COLCON_CURRENT_PREFIX={shlex.quote(str(path.parent))} . {shlex.quote(str(path))}"
