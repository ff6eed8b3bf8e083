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
    """

    pid: int
    what: str
    command: str


def processes_of(cache: Path) -> Iterator[SimyardProcess]:
    """Yields the processes of this account that use a cache folder; this one and those that started it are left out.

    A process that hides its environment, as a robot's agent does, counts if its arguments name the folder.
    """
    own = {os.getpid(), *_ancestors(os.getpid())}
    for folder in sorted(_PROC.glob("[0-9]*"), key=lambda each: int(each.name)):
        arguments = _arguments(folder)
        what = _what(arguments)
        if what and int(folder.name) not in own and _uses(folder, arguments, cache):
            yield SimyardProcess(int(folder.name), what, " ".join(arguments)[:100])


def _what(arguments: Sequence[str]) -> str:
    for module, what in _MODULES.items():
        if any(each == module or each.startswith(f"{module}.") for each in arguments):
            return what
    names = [Path(each).name for each in arguments[:2]]
    if "simyard-agent" in names:
        return "robot agent"
    if "simyard" in names:
        return "simyard " + " ".join(arguments[names.index("simyard") + 1 :][:1])
    return ""


def _uses(folder: Path, arguments: Sequence[str], cache: Path) -> bool:
    try:
        pairs = (each.partition("=") for each in _texts(folder / "environ"))
        environment = {name: value for name, _, value in pairs}
    except OSError:
        environment = {}
    if not environment:
        return any(str(cache) in each for each in arguments)
    return "HOME" in environment and chosen_folder(environment).resolve() == cache.resolve()


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
