"""What Simyard has left on this machine, for who removes it: `simyard gc --machine` tells it, and removes it if asked.

Only what is certainly Simyard's goes: a name that Simyard gives (a digest, a file of its server) in a folder of its
cache, of this very account, and no link. All else stays, with the reason. No link is followed.
"""

import os
import pwd
import re
import stat
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from specs.base import Fault, Spec
from specs.errors import DocumentError
from tasks.housekeeping.cache_garbage import remove_path
from tasks.housekeeping.machine_processes import SimyardProcess, processes_of
from tasks.server.resident import end_kept, kept_process

_DIGEST = "[0-9a-f]{64}"
_TEMPORARY = r"\.[\w.-]+"
_SERVER = (
    r"prefect\.db(-shm|-wal|-journal)?|memo_store\.toml|kept\.json|password|port|checkout|starting\.lock"
    r"|server-\d+\.log|starting-\w+\.log|storage"
)
_CACHE: Mapping[str, str] = {
    "programs": r"[0-9a-f]{32}|jit_\w+-[0-9a-f]{64}-(cache|atime)",
    "bundles": f"{_DIGEST}|{_TEMPORARY}",
    "data/objects": f"{_DIGEST}|{_TEMPORARY}",
    "data/mounts": f"{_DIGEST}|{_TEMPORARY}",
    "data/seen": rf"{_DIGEST}\.json|{_TEMPORARY}",
    "engines": rf"{_DIGEST}\.json|{_TEMPORARY}",
    "timings": rf"{_DIGEST}\.json|{_TEMPORARY}",
    "agents": "[0-9a-f]{12}",
}
_HOME = re.compile(r"prefect(-[0-9a-f]{8})?")
_KEYS = ("keys", "owner")
_TEMP = re.compile(r"simyard-(report|gc|export|verify|recordings|results|recount|evidence|source)-[a-z0-9_]{8}")
_YOUNG_S = 86_400.0
STAYS_KEYS = "stays: keys, which cannot be made again"
_GOES = "goes"


class MachineRow(Spec):
    """Something on this machine.

    Attributes:
        what: A few words.
        place: Its path, or a process and its number.
        owner: The account that it is of.
        bytes: Of all that is in it; 0 for a process.
        fate: ``goes``, or why it stays.
    """

    what: str
    place: str
    owner: str
    bytes: int
    fate: str

    @property
    def goes(self) -> bool:
        """Returns whether it is Simyard's for certain, and is removed."""
        return self.fate == _GOES


class MachineReport(Spec):
    """What Simyard has left on this machine; ``removed`` says whether what goes is gone."""

    cache: str
    removed: bool
    rows: tuple[MachineRow, ...]


def clean_machine(cache: Path, home: Path, *, remove: bool) -> MachineReport:
    """Returns what Simyard has left of this account, having removed what is certainly its own if asked.

    Args:
        cache: The cache folder.
        home: The account's home folder.
        remove: Whether to remove it; kept servers are ended first.

    Raises:
        DocumentError: The cache folder is one that holds more than a cache, or a process works with it.
    """
    _check_place(cache, home)
    homes = [path for path in _children(cache) if _HOME.fullmatch(path.name) and not path.is_symlink()]
    kept = {pid: folder for folder in homes if (pid := kept_process(folder))}
    working = [each for each in processes_of(cache) if each.pid not in kept]
    rows = [
        *(_process_row(each, _GOES) for each in processes_of(cache) if each.pid in kept),
        *(_process_row(each, "stays: end it first") for each in working),
        *_cache_rows(cache),
        *_temporary_rows(),
        *_prefect_rows(home),
    ]
    if remove:
        if working:
            names = ", ".join(f"{each.what} (process {each.pid})" for each in working)
            raise _refused(str(cache), f"a cache folder that no process works with; end first: {names}")
        for folder in kept.values():
            end_kept(folder)
        _remove([Path(row.place) for row in rows if row.goes and row.place.startswith("/")], cache)
    return MachineReport(cache=str(cache), removed=remove, rows=tuple(rows))


def _check_place(cache: Path, home: Path) -> None:
    place = cache.resolve()
    shared = {Path("/"), Path(tempfile.gettempdir()).resolve(), *(home.resolve() / each for each in (".", ".cache"))}
    if cache.is_symlink() or place in {*shared, *home.resolve().parents}:
        raise _refused(str(cache), "a folder of Simyard alone; this one holds other things, so remove by hand")


def _cache_rows(cache: Path) -> Iterator[MachineRow]:
    for folder, pattern in _CACHE.items():
        yield from _folder_rows(cache, folder, pattern, folder)
    for path in _children(cache):
        if _HOME.fullmatch(path.name):
            yield from _folder_rows(cache, path.name, _SERVER, "Prefect server's files")
        elif path.name in _KEYS:
            yield _row(path.name, path, STAYS_KEYS)
        elif path.name not in {each.partition("/")[0] for each in _CACHE}:
            yield _row("unknown", path, "stays: not known to be Simyard's")


def _folder_rows(cache: Path, folder: str, pattern: str, what: str) -> Iterator[MachineRow]:
    """Yields a row for each thing in a folder that Simyard names so; for the others, why they stay."""
    steps = [cache / part for part in _ways(folder)]
    if any(step.is_symlink() for step in steps):
        yield _row(what, steps[-1], "stays: a link")
        return
    for path in _children(cache / folder):
        yield _row(what, path, _fate(path, pattern))


def _ways(folder: str) -> list[str]:
    parts = folder.split("/")
    return ["/".join(parts[: number + 1]) for number in range(len(parts))]


def _fate(path: Path, pattern: str) -> str:
    found = path.lstat()
    if stat.S_ISLNK(found.st_mode):
        return "stays: a link"
    if not re.fullmatch(pattern, path.name):
        return "stays: not known to be Simyard's"
    return _GOES if found.st_uid == os.geteuid() else "stays: of another account"


def _temporary_rows() -> Iterator[MachineRow]:
    for path in _children(Path(tempfile.gettempdir())):
        if _TEMP.fullmatch(path.name):
            fate = _fate(path, _TEMP.pattern)
            young = time.time() - path.lstat().st_mtime < _YOUNG_S
            yield _row("left by a command", path, "stays: younger than a day" if fate == _GOES and young else fate)


def _prefect_rows(home: Path) -> Iterator[MachineRow]:
    for path in dict.fromkeys([home / ".prefect", Path(os.environ.get("PREFECT_HOME", home / ".prefect"))]):
        if path.is_dir():
            yield _row("Prefect", path, "stays: Prefect's own, which other programs may use")


def _process_row(process: SimyardProcess, fate: str) -> MachineRow:
    owner = _owner(os.geteuid())
    return MachineRow(what=process.what, place=f"process {process.pid}", owner=owner, bytes=0, fate=fate)


def _row(what: str, path: Path, fate: str) -> MachineRow:
    found = path.lstat()
    return MachineRow(what=what, place=str(path), owner=_owner(found.st_uid), bytes=_bytes(path), fate=fate)


def _bytes(path: Path) -> int:
    total = path.lstat().st_size if not path.is_dir() else 0
    for base, _, names in os.walk(path, followlinks=False) if not path.is_symlink() else ():
        for name in names:
            try:
                total += Path(base, name).lstat().st_size
            except OSError:  # it went meanwhile
                continue
    return total


def _children(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:  # it is not there, is no folder, or is another account's
        return []


def _remove(places: list[Path], cache: Path) -> None:
    for path in places:
        remove_path(path)
    emptied = sorted({path.parent for path in places if cache in path.parents}, key=lambda path: -len(path.parts))
    for folder in (*emptied, cache / "data", cache):
        try:
            folder.rmdir()
        except OSError:  # something stays in it
            continue


def _owner(number: int) -> str:
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return str(number)


def _refused(value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="SIMYARD_CACHE", value=value, allowed=allowed)], source="simyard")
