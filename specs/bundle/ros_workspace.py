"""Where the ROS packages of a bundle have what ROS looks for: the same in an episode and on a robot.

A bundle is the ``src`` of a workspace, or its ``install`` space, or a folder that holds several of them.
"""

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path, PurePosixPath

from specs.bundle.launched_file import PACKAGE_XML

_INSTALL_MARK = "_setup_util.py"


def workspace_variables(folder: Path, files: Collection[str], given: Mapping[str, str]) -> dict[str, str]:
    """Returns the environment variables of ROS 1 that name folders, with a bundle's in front.

    As the set-up file of a workspace does: packages, programs, libraries and Python modules of the bundle are found
    before those of ROS. A package that is not built is imported from its ``src``, as from catkin's devel space.

    Args:
        folder: Where the bundle is unpacked.
        files: Names of its files.
        given: The variables as ROS has them.
    """
    spaces = [PurePosixPath(name).parent for name in sorted(files) if PurePosixPath(name).name == _INSTALL_MARK]
    modules = [*(space / "lib/python3/dist-packages" for space in spaces), *_sources(frozenset(files))]
    found: dict[str, list[PurePosixPath]] = {
        "ROS_PACKAGE_PATH": [PurePosixPath()],
        "CMAKE_PREFIX_PATH": spaces,
        "LD_LIBRARY_PATH": [space / "lib" for space in spaces],
        "PYTHONPATH": modules,
    }
    return {
        name: ":".join([*(str(folder / each) for each in own), *filter(None, [given.get(name, "")])])
        for name, own in found.items()
        if own
    }


def _sources(files: Collection[str]) -> Iterator[PurePosixPath]:
    """Yields the folders with the Python modules of packages that say so by a setup.py."""
    owners = (PurePosixPath(name).parent for name in sorted(files) if PurePosixPath(name).name == PACKAGE_XML)
    for owner in owners:
        inside = f"{owner / 'src'}/"
        has_modules = any(each.startswith(inside) and each.endswith("/__init__.py") for each in files)
        if has_modules and str(owner / "setup.py") in files:
            yield owner / "src"
