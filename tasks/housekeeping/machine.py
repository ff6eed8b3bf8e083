"""What Simyard has left on this machine, for who removes it: `simyard gc --machine` tells it, and removes it if asked.

Only what is certainly Simyard's goes: a name that Simyard gives (a digest, a file of its server) in a folder of its
cache, of this very account, and no link. All else stays, with the reason. No link and no mount is followed.
"""

import os
import pwd
import re
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from specs.base import Fault, Spec
from specs.errors import DocumentError
from tasks.housekeeping.cache_garbage import remove_path
from tasks.housekeeping.entry_fate import GOES, LINK, MOUNTED, UNKNOWN, entry_fate, mounts, temporary_fate
from tasks.housekeeping.machine_processes import SimyardProcess, prefect_home_of, processes_of
from tasks.server.resident import end_kept, is_kept_elsewhere, kept_process
from tasks.storage.base.keys import STORE

_DIGEST = "[0-9a-f]{64}"
_TEMPORARY = (
    r"\.gc-[0-9a-f]{32}|\.([0-9a-f]{64}\.)?[0-9a-f]{8}\.tmp|\.[0-9a-f]{32}\.tmp|\.(download|archive|tar)-[a-z0-9_]{8}"
)
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
    "trends": rf"[0-9a-f]{{16}}\.json|{_TEMPORARY}",
    "agents": "[0-9a-f]{12}",
}
_HOME = re.compile(r"prefect(-[0-9a-f]{8})?")
_KEYS = ("keys", "owner")
_TEMP = re.compile(
    r"simyard-(report|gate|gc|export|verify|recordings|bags|results|recount|evidence|source)-[a-z0-9_]{8}"
)
STAYS_KEYS = "stays: keys, which cannot be made again"


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
        return self.fate == GOES


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
    cache = cache.absolute()
    kept, working = _processes(cache)
    rows = [
        *(_process_row(SimyardProcess(pid, "Prefect server", ""), GOES) for pid in kept),
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
        rows = _removed(rows, cache)
    return MachineReport(cache=str(cache), removed=remove, rows=tuple(rows))


def _processes(cache: Path) -> tuple[dict[int, Path], list[SimyardProcess]]:
    """Returns the kept servers of a cache with their folders, and the other processes that work with it.

    The note of a server is in the copy of a cache, too; its process knows whose it is.
    """
    homes = [path for path in _children(cache) if _HOME.fullmatch(path.name) and not path.is_symlink()]
    noted = {pid: folder for folder in homes if (pid := kept_process(folder))}
    kept = {pid: folder for pid, folder in noted.items() if prefect_home_of(pid) == folder.resolve()}
    return kept, [each for each in processes_of(cache) if each.pid not in kept and each.parent not in kept]


def _check_place(cache: Path, home: Path) -> None:
    place = cache.resolve()
    caches = os.environ.get("XDG_CACHE_HOME") or home / ".cache"
    named = ("/", tempfile.gettempdir(), "/tmp", "/var/tmp", home, pwd.getpwuid(os.geteuid()).pw_dir, caches)  # noqa: S108 - nothing is written there
    shared = {Path(each).resolve() for each in named}
    if cache.is_symlink() or place in {*shared, *home.resolve().parents}:
        raise _refused(str(cache), "a folder of Simyard alone; this one holds other things, so remove by hand")
    if (place / STORE).exists():
        raise _refused(str(cache), "a folder of Simyard's cache alone; this one is a store, which no command removes")


def _cache_rows(cache: Path) -> Iterator[MachineRow]:
    for folder, pattern in _CACHE.items():
        yield from _folder_rows(cache, folder, pattern, folder)
    chosen = Path(os.environ.get("PREFECT_HOME") or cache / "none").resolve()
    for path in _children(cache):
        if _HOME.fullmatch(path.name) and path.resolve() == chosen and not path.is_symlink():
            yield _row("Prefect", path, "stays: PREFECT_HOME names it, so that other programs may use it")
        elif _HOME.fullmatch(path.name) and is_kept_elsewhere(path):
            yield _row(
                "Prefect server's files", path, "stays: a server of another machine may use it; simyard down forgets it"
            )
        elif _HOME.fullmatch(path.name):
            yield from _folder_rows(cache, path.name, _SERVER, "Prefect server's files")
        elif path.name in _KEYS:
            yield _row(path.name, path, STAYS_KEYS)
        elif path.name not in {each.partition("/")[0] for each in _CACHE}:
            yield _row("unknown", path, UNKNOWN)


def _folder_rows(cache: Path, folder: str, pattern: str, what: str) -> Iterator[MachineRow]:
    """Yields a row for each thing in a folder that Simyard names so; for the others, why they stay."""
    steps = [cache / part for part in _ways(folder)]
    if any(step.is_symlink() for step in steps):
        yield _row(what, steps[-1], LINK)
        return
    if mounts() & {step.resolve() for step in steps}:
        yield _row(what, steps[-1], MOUNTED)
        return
    for path in _children(cache / folder):
        yield _row(what, path, entry_fate(path, pattern))


def _ways(folder: str) -> list[str]:
    parts = folder.split("/")
    return ["/".join(parts[: number + 1]) for number in range(len(parts))]


def _temporary_rows() -> Iterator[MachineRow]:
    for path in _children(Path(tempfile.gettempdir())):
        if _TEMP.fullmatch(path.name):
            yield _row("left by a command", path, temporary_fate(path, _TEMP.pattern))


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


def _removed(rows: list[MachineRow], cache: Path) -> list[MachineRow]:
    """Removes what goes, and then the folders that it leaves empty; returns the rows, with why what is left is."""
    done: list[MachineRow] = []
    emptied: set[Path] = set()
    for row in rows:
        path = Path(row.place)
        if not row.goes or not path.is_absolute():  # a process has no path
            done.append(row)
            continue
        try:
            remove_path(path)
        except OSError as exc:
            done.append(row.model_copy(update={"fate": f"stays: cannot be removed: {exc.strerror}"}))
            continue
        done.append(row)
        emptied |= {each for each in path.parents if each == cache or cache in each.parents}
    for folder in sorted(emptied, key=lambda path: -len(path.parts)):
        with suppress(OSError):  # something stays in it
            folder.rmdir()
    return done


def _owner(number: int) -> str:
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return str(number)


def _refused(value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="SIMYARD_CACHE", value=value, allowed=allowed)], source="simyard")
