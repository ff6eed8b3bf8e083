"""What the processes of an application find in their environment, and the folders that it names."""

import contextlib
from collections.abc import Mapping
from pathlib import Path

from specs.bundle.launched_file import bundle_files
from specs.bundle.ros_workspace import workspace_variables
from tasks.ros.launch.installation import RosInstallation

# One thread each: many lanes share the machine's cores, and sums of floats keep their order.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
_WRITTEN = ("tmp", "log", "bin")


def node_environment(
    installation: RosInstallation, bundle: Path, master_uri: str, home: Path, variables: Mapping[str, str]
) -> dict[str, str]:
    """Returns the whole environment of a node: nothing of this process's own is in it.

    Args:
        installation: The ROS that runs the node.
        bundle: Folder that holds the ROS packages.
        master_uri: Address of the episode's master.
        home: The episode's folder; see ``make_home``.
        variables: The episode's own; what ROS and lock-step need goes before them.
    """
    ros = installation.environment()
    return {
        **variables,
        **ros,
        "PATH": f"{home / 'bin'}:{ros['PATH']}",
        **workspace_variables(bundle, bundle_files(bundle), ros),
        "ROS_MASTER_URI": master_uri,
        # All of an episode lies on one loopback device, and no name has to be looked up.
        "ROS_IP": "127.0.0.1",
        **episode_environment(home),
    }


def episode_environment(home: Path) -> dict[str, str]:
    """Returns what the processes of ROS 1 and of ROS 2 alike find in their environment.

    Args:
        home: The episode's folder; by its name in ``ROS_HOME`` they are found again.
    """
    return {
        "LANG": "C.UTF-8",
        "HOME": str(home),
        "TMPDIR": str(home / "tmp"),
        "ROS_HOME": str(home),
        "ROS_LOG_DIR": str(home / "log"),
        # A node's output is read as it comes, and its sets have one order in each episode.
        "PYTHONUNBUFFERED": "1",
        "PYTHONHASHSEED": "0",
        # Bundles are shared by episodes, and may be read-only.
        "PYTHONDONTWRITEBYTECODE": "1",
        **dict.fromkeys(_ONE_THREAD, "1"),
    }


def make_home(home: Path, installation: RosInstallation) -> Path:
    """Makes the folder that an episode's nodes may write to, and returns it.

    A ``python`` lies in its ``bin``: scripts from before Noetic ask for it, and Debian has none.
    """
    for name in _WRITTEN:
        (home / name).mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(FileExistsError):
        (home / "bin/python").symlink_to(installation.python)
    return home
