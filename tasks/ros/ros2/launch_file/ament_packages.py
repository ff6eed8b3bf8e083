"""Packages of a bundle and of ROS 2: where they are, and which executables they have.

A bundle holds install spaces (``share/ament_index``), as ``colcon build`` makes them, or source packages
(``package.xml``), whose executables are found by name; an executable of a Python package that is not built is the
function that its ``setup.py`` or ``setup.cfg`` names.

Source: ROS 2's design article "ament index"; setuptools' console scripts.
"""

import ast
import configparser
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from specs.errors import LaunchRefused
from tasks.ros.launch.packages import read_manifest

_DEPTH = 6
_INDEX = "share/ament_index/resource_index/packages"
_SCRIPT = re.compile(r"^\s*([\w.-]+)\s*=\s*([\w.]+):(\w+)\s*$")
# Folders of a source package that hold no programs.
_NO_PROGRAMS = frozenset({"launch", "test", "tests", "config", "params", "doc", "docs"})


class AmentPackage(NamedTuple):
    """A package.

    Attributes:
        share: Its folder of launch files, parameters and models.
        prefix: Where it is installed; its own folder if it is a source package.
        programs: Commands by an executable's name.
        python: Folders of Python modules that it brings.
    """

    share: str
    prefix: str
    programs: Mapping[str, list[str]]
    python: list[str]


def ament_packages(bundle: Path, installed: tuple[Path, ...], python: str) -> dict[str, AmentPackage]:
    """Returns the packages that a launch file may name; those of the bundle come before ROS 2's.

    Args:
        bundle: Folder that holds the ROS packages.
        installed: Where ROS 2 is installed.
        python: What runs executables of Python packages that are not built.

    Raises:
        LaunchRefused: A package.xml, setup.py or setup.cfg cannot be read.
    """
    found: dict[str, AmentPackage] = {}
    for prefix in reversed(installed):
        found.update(_installed(prefix))
    for folder in _package_folders(bundle):
        if (folder / _INDEX).is_dir():
            found.update(_installed(folder))
        else:
            name = read_manifest(folder / "package.xml").findtext("name", folder.name).strip()
            found[name] = AmentPackage(str(folder), str(folder), *_source_programs(folder, python))
    return found


def _package_folders(bundle: Path) -> Iterator[Path]:
    """Yields install spaces and folders with a package.xml; none lies inside another one."""
    todo = [(bundle, 0)]
    while todo:
        folder, depth = todo.pop()
        if (folder / _INDEX).is_dir() or (folder / "package.xml").is_file():
            yield folder
        elif depth < _DEPTH:
            todo += [(each, depth + 1) for each in sorted(folder.iterdir()) if each.is_dir() and not each.is_symlink()]


def _installed(prefix: Path) -> dict[str, AmentPackage]:
    """Returns the packages of an install space."""
    python = [str(each) for each in sorted(prefix.glob("lib/python3*/*-packages"))]
    found: dict[str, AmentPackage] = {}
    for name in sorted(each.name for each in (prefix / _INDEX).glob("*")):
        folder = prefix / "lib" / name
        programs = {each.name: [str(each)] for each in sorted(folder.glob("*")) if os.access(each, os.X_OK)}
        found[name] = AmentPackage(str(prefix / "share" / name), str(prefix), programs, python)
    return found


def _source_programs(folder: Path, python: str) -> tuple[dict[str, list[str]], list[str]]:
    """Returns the executables of a source package, and the folders of its Python modules."""
    programs: dict[str, list[str]] = {}
    for root, folders, files in os.walk(folder):
        folders[:] = sorted(each for each in folders if each not in _NO_PROGRAMS and not each.startswith("."))
        for path in (Path(root, each) for each in sorted(files)):
            if os.access(path, os.X_OK):
                programs.setdefault(path.name, [str(path)])
    modules = [each for each in (folder / "src", folder) if any(each.glob("*/__init__.py"))]
    for name, module, function in _console_scripts(folder):
        call = f"import sys; sys.argv[0] = {name!r}; from {module} import {function}; sys.exit({function}())"
        programs[name] = [python, "-c", call]
    return programs, [str(each) for each in modules]


def _console_scripts(folder: Path) -> list[tuple[str, str, str]]:
    """Returns name, module and function of a Python package's executables."""
    lines: list[str] = []
    try:
        if (folder / "setup.py").is_file():
            tree = ast.parse((folder / "setup.py").read_text())
            texts = (each.value for each in ast.walk(tree) if isinstance(each, ast.Constant))
            lines += [each for each in texts if isinstance(each, str)]
        if (folder / "setup.cfg").is_file():
            parser = configparser.ConfigParser(interpolation=None)
            parser.read(folder / "setup.cfg")
            lines += parser.get("options.entry_points", "console_scripts", fallback="").splitlines()
    except (SyntaxError, ValueError, RecursionError, MemoryError, configparser.Error) as exc:
        why = " ".join(str(exc).split())[:300]
        raise LaunchRefused(f"{folder.name}: its setup.py or setup.cfg cannot be read: {why}") from exc
    found = (_SCRIPT.match(each) for each in lines)
    return [(each[1], each[2], each[3]) for each in found if each]
