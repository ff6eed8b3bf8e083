"""Which file of a bundle a launch configuration means, and where ROS finds the bundle's packages.

It is decided here alone, from the names of the bundle's files. Simulations, documents and robots ask here, so that a
robot runs the launch file that episodes were driven with. A bundle is the ``src`` of a workspace, or its ``install``
space, or a folder that holds several of them.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath

ROS_SUFFIX = ".launch"
ROS2_SUFFIXES = (".launch.py", ".launch.xml", ".launch.yaml")
PACKAGE_XML = "package.xml"
IMAGE_FILE = "image.json"
"""Of a bundle that is a container image."""
_INSTALL_MARK = "_setup_util.py"
# So many launch files are named to choose from.
_NAMED = 6


def names_ros_launch(launch_file: str) -> bool:
    """Returns whether a launchFile is named as those of ROS are."""
    return launch_file.endswith((ROS_SUFFIX, *ROS2_SUFFIXES))


def is_ros2(launch_file: str) -> bool:
    """Returns whether a launchFile is named as those of ROS 2 are, and those of ROS 1 are not."""
    return launch_file.endswith(ROS2_SUFFIXES)


def bundle_files(folder: Path) -> list[str]:
    """Returns the names of the files in a folder, relative to it, with ``/``."""
    return [path.relative_to(folder).as_posix() for path in sorted(folder.rglob("*")) if path.is_file()]


def package_folders(files: Iterable[str], package: str) -> list[str]:
    """Returns where a bundle may have a ROS package: at its root, or where a folder so called has a ``package.xml``."""
    owners = (PurePosixPath(name).parent for name in sorted(files) if PurePosixPath(name).name == PACKAGE_XML)
    return list(dict.fromkeys((package, *(str(owner) for owner in owners if owner.name == package))))


def ros_launch_file(files: Collection[str], package: str, launch_file: str) -> str | None:
    """Returns the ROS launch file that is meant, by its name in the bundle; None if the bundle has none.

    As roslaunch does, it finds a file by its name wherever it lies in its package.

    Args:
        files: Names of the bundle's files.
        package: The launch configuration's packageName.
        launch_file: Its launchFile.
    """
    if not names_ros_launch(launch_file):
        return None
    return next((name for name in _launch_places(files, package, launch_file) if name in files), None)


def simulated_file(files: Collection[str], package: str, launch_file: str) -> str | None:
    """Returns the file that drives a robot in simulation: a ROS launch file, a Python module, an ONNX policy, or None.

    Documents from before name ``x.launch`` for a module ``x.py``, too: where the bundle has no such launch file, the
    module is meant.
    """
    if (found := ros_launch_file(files, package, launch_file)) is not None:
        return found
    places = (module_file(package, launch_file), policy_file(package, launch_file))
    return next((name for name in places if name in files), None)


def module_name(launch_file: str) -> str:
    """Returns the name of the Python module that is meant, if one is: documents from before say ``x.launch``."""
    return launch_file.removesuffix(".py").removesuffix(ROS_SUFFIX)


def module_file(package: str, launch_file: str) -> str:
    """Returns where a bundle has the Python module that is launched."""
    return f"{package}/{module_name(launch_file)}.py"


def policy_file(package: str, launch_file: str) -> str:
    """Returns where a bundle has the ONNX policy that is launched in place of a module."""
    return f"{package}/{launch_file.removesuffix('.onnx')}.onnx"


def looked_for(files: Collection[str], package: str, launch_file: str) -> str:
    """Returns the names under which a file that drives a robot was looked for, and those to choose from, for a person.

    Args:
        files: Names of the bundle's files.
        package: The launch configuration's packageName.
        launch_file: Its launchFile.
    """
    module = module_file(package, launch_file)
    if not names_ros_launch(launch_file):
        return module
    places = f"{package}/launch/{launch_file} or {package}/{launch_file}"
    have = sorted(filter(names_ros_launch, files))
    more = f" and {len(have) - _NAMED} more" if len(have) > _NAMED else ""
    choice = f": name one that it has: {', '.join(have[:_NAMED])}{more}" if have else ""
    return f"{places}, nor {launch_file} elsewhere in {package}, nor {module}{choice}"


def _launch_places(files: Collection[str], package: str, launch_file: str) -> Iterator[str]:
    for folder in package_folders(files, package):
        inside, named = f"{folder}/", f"/{launch_file}"
        yield from (f"{folder}/launch/{launch_file}", f"{folder}/{launch_file}")
        yield from sorted(name for name in files if name.startswith(inside) and name.endswith(named))


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
