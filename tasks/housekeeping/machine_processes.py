"""The processes of Simyard that this account runs, and which cache folder each uses."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from tasks.storage.base.cache_folder import chosen_folder

_PROC = Path("/proc")
_MODULES = {
    "tasks.server.guarded_server": "Prefect server",
    "tasks.deploy.robot.agent": "robot agent",
    "tasks.simulate.process": "simulator",
}


class SimyardProcess(NamedTuple):
    """A live process of Simyard.

    Attributes:
        pid: Its number.
        what: Such as ``robot agent``.
        command: Its arguments, for a person.
        parent: The number of the process that started it; 0 if it is not known.
    """

    pid: int
    what: str
    command: str
    parent: int = 0


def processes_of(cache: Path) -> Iterator[SimyardProcess]:
    """Yields the processes of this account that use a cache folder; this one and those that started it are left out.

    A process that hides its environment, as a robot's agent does, counts if its arguments name the folder; and each
    program counts that has a file of the cache open, such as a script that imports Simyard.
    """
    own = {os.getpid(), *_ancestors(os.getpid())}
    for folder in sorted(_PROC.glob("[0-9]*"), key=lambda each: int(each.name)):
        arguments = _arguments(folder)
        if not arguments or int(folder.name) in own:
            continue
        what = _what(arguments)
        if (what and _uses(folder, arguments, cache)) or _has_open(folder, cache.resolve()):
            parent = next(_ancestors(int(folder.name)), 0)
            name = what or Path(arguments[0]).name
            yield SimyardProcess(int(folder.name), name, " ".join(arguments)[:100], parent)


def prefect_home_of(pid: int) -> Path | None:
    """Returns the folder that a process was told to be Prefect's; None if it was not told, or does not say."""
    folder = _PROC / str(pid)
    try:
        named = _environment(folder).get("PREFECT_HOME")
        return (folder / "cwd").readlink().joinpath(named).resolve() if named else None
    except OSError:
        return None


def _what(arguments: Sequence[str]) -> str:
    for module, what in _MODULES.items():
        if any(each == module or each.startswith(f"{module}.") for each in arguments):
            return what
    names = [Path(each).name for each in arguments[:2]]
    if "simyard-agent" in names:
        return "robot agent"
    if names[1:] == ["-m"]:  # python -m simyard
        names = [Path(each).name for each in arguments[:3]]
    if "simyard" in names:
        return "simyard " + " ".join(arguments[names.index("simyard") + 1 :][:1])
    return ""


def _uses(folder: Path, arguments: Sequence[str], cache: Path) -> bool:
    try:
        environment = _environment(folder)
    except OSError:
        environment = {}
    if not environment:
        return any(str(cache) in each for each in arguments)
    return "HOME" in environment and chosen_folder(environment).resolve() == cache.resolve()


def _has_open(folder: Path, cache: Path) -> bool:
    try:
        return any(_is_below(file, cache) for file in (folder / "fd").iterdir())
    except OSError:  # it has ended, or shows nobody what it has open
        return False


def _is_below(file: Path, cache: Path) -> bool:
    try:
        return cache in file.readlink().parents
    except OSError:  # it was closed meanwhile
        return False


def _environment(folder: Path) -> dict[str, str]:
    pairs = (each.partition("=") for each in _texts(folder / "environ"))
    return {name: value for name, _, value in pairs}


def _arguments(folder: Path) -> list[str]:
    try:
        return _texts(folder / "cmdline") if folder.stat().st_uid == os.geteuid() else []
    except OSError:  # it has ended
        return []


def _texts(file: Path) -> list[str]:
    return [each.decode(errors="replace") for each in file.read_bytes().split(b"\0") if each]


def _ancestors(pid: int) -> Iterator[int]:
    while pid > 1:
        try:
            pid = int((_PROC / str(pid) / "stat").read_text().rpartition(")")[2].split()[1])
        except OSError:
            return
        yield pid
