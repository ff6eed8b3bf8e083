"""What Simyard has left on this machine, for who removes it: `simyard gc --machine` tells it, and removes it if asked.

Only what is certainly Simyard's goes: a name that Simyard gives (a digest, a file of its server) in a folder of its
cache, of this very account, and no link. All else stays, with the reason. No link and no mount is followed.
"""

import os
import pwd
import re
import shutil
import stat
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from uuid import uuid4

from specs.base import Spec
from specs.errors import DocumentError
from tasks.server.resident import end_kept, is_kept_elsewhere, kept_process
from tasks.storage.backends.local import disk_now_s
from tasks.storage.base.keys import STORE
from tasks.storage.base.local_files import chosen_folder

_PROC = Path("/proc")
_MODULES = {
    "tasks.applications": "robot draft",
    "tasks.server": "Prefect server",
    "tasks.deploy.robot": "robot agent",
    "tasks.simulate": "simulator",
    "tasks.worlds": "world generator",
    "tasks.export": "renderer",
    "tasks.render": "camera renderer",
    "tasks.ros": "launch file",
    "flows.queue": "queue worker",
}
"""The packages whose modules are programs of their own."""
GOES = "goes"
UNKNOWN = "stays: not known to be Simyard's"
LINK = "stays: a link"
MOUNTED = "stays: something is mounted in it"
_MOUNTS = Path("/proc/self/mountinfo")
_ESCAPE = re.compile(r"\\([0-7]{3})")
_YOUNG_S = 86_400.0
_ENTRIES = {
    "compiled programs": "programs",
    "unpacked bundles": "bundles",
    "data objects": "data/objects",
    "data mounts": "data/mounts",
    "notes of data": "data/seen",
    "engines": "engines",
    "timings": "timings",
    "nights": "trends",
    "lists of jobs": "lists",
    "drafts of robots": "drafts",
    "container images": "images",
    "files of images": "image-files",
}
_ASIDE = ".gc-"
_DIGEST = "[0-9a-f]{64}"
_TEMPORARY = (
    r"\.gc-[0-9a-f]{32}|\.([0-9a-f]{64}\.)?[0-9a-f]{8}\.tmp|\.[0-9a-f]{32}\.tmp"
    r"|\.(download|archive|tar|making|unpack)-[a-z0-9_]{8}|\.turn-(bundle-)?[0-9a-f]{32,64}"
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
    "image-files": rf"{_DIGEST}-100[0-7]{{3}}-\d+|{_TEMPORARY}",
    "images": rf"bundle-[0-9a-f]{{32}}|{_DIGEST}|{_TEMPORARY}",
    "timings": rf"{_DIGEST}\.json|{_TEMPORARY}",
    "trends": rf"[0-9a-f]{{16}}\.json|{_TEMPORARY}",
    "lists": r"[0-9a-f]{16}\.sqlite(-journal)?",
    "agents": "[0-9a-f]{12}",
}
_HOME = re.compile(r"prefect(-[0-9a-f]{8})?")
_KEYS = ("keys", "owner")
_TEMP = re.compile(
    r"simyard-(report|gate|gc|export|verify|recordings|bags|results|recount|evidence|source|simulator|check|bundle|import|launch)-[a-z0-9_]{8}"
)
STAYS_KEYS = "stays: keys, which cannot be made again"


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


def entry_fate(path: Path, pattern: str) -> str:
    """Returns whether a thing in a folder of Simyard's goes: by its name, its owner, and all that is in it."""
    found = path.lstat()
    if stat.S_ISLNK(found.st_mode):
        return LINK
    if not re.fullmatch(pattern, path.name):
        return UNKNOWN
    if found.st_uid != os.geteuid():
        return "stays: of another account"
    if _holds_mount(path):
        return MOUNTED
    foreign = any(each.st_uid != found.st_uid for each in _inside(path))
    return "stays: of another account, in part" if foreign else GOES


def temporary_fate(path: Path, pattern: str) -> str:
    """Returns the same of a folder for temporary files, which is shared: its name alone says little.

    Simyard's are folders for one account alone. One in which something was written within a day may be in use.
    """
    fate, found = entry_fate(path, pattern), path.lstat()
    if fate != GOES:
        return fate
    if not stat.S_ISDIR(found.st_mode) or stat.S_IMODE(found.st_mode) != stat.S_IRWXU:
        return UNKNOWN
    newest_s = max(each.st_mtime for each in (found, *_inside(path)))
    return "stays: younger than a day" if time.time() - newest_s < _YOUNG_S else GOES


def mounts() -> frozenset[Path]:
    """Returns the folders on which something is mounted: what is in them is another folder's content."""
    try:
        lines = _MOUNTS.read_text(errors="surrogateescape").splitlines()
    except OSError:  # the system does not tell
        return frozenset()
    # proc(5): the fifth field, in which spaces and the like are octal numbers
    names = (line.split(" ")[4] for line in lines)
    return frozenset(Path(_ESCAPE.sub(lambda found: chr(int(found[1], 8)), name)) for name in names)


def _holds_mount(path: Path) -> bool:
    place = path.resolve()
    return any(place == each or place in each.parents for each in mounts())


def _inside(path: Path) -> Iterator[os.stat_result]:
    for base, folders, files in os.walk(path):
        for name in (*folders, *files):
            try:
                yield Path(base, name).lstat()
            except FileNotFoundError:  # it went meanwhile
                continue


# Keys, robots' disks and Prefect's database lie in the same folder, and are never touched. An entry goes when nobody
# has read or written anything in it for long, by the clock of the disk; it is moved aside before it is removed, and
# looked at again there, so that who comes for it finds it whole or not at all.
@dataclass(frozen=True)
class CacheEntry:
    """Something in the cache.

    Attributes:
        path: A file, or a folder with all that is in it.
        what: Its kind.
        size_bytes: Of all that is in it.
        used_s: When anything in it was read or written last, as the disk tells it.
    """

    path: Path
    what: str
    size_bytes: int
    used_s: float


def unused_entries(cache: Path, unused_s: float) -> list[CacheEntry]:
    """Returns what nobody has used for so long.

    Args:
        cache: The folder; it need not be there.
        unused_s: Seconds.
    """
    if not cache.is_dir() or (cache / STORE).exists():  # a store keeps its bundles in a folder of the same name
        return []
    before_s = disk_now_s(cache) - unused_s
    return [entry for entry in _cached(cache) if entry.used_s <= before_s]


def remove_entry(entry: CacheEntry) -> bool:
    """Removes an entry; returns whether it is gone: one that was used since it was seen stays."""
    aside = entry.path.with_name(f"{_ASIDE}{uuid4().hex}")
    try:
        entry.path.rename(aside)
    except FileNotFoundError:  # another gc was faster
        return True
    now = _seen(aside, entry.what)
    if now.used_s > entry.used_s and not entry.path.name.startswith("."):
        _put_back(aside, entry.path)
        return False
    remove_path(aside)
    return True


def _put_back(aside: Path, path: Path) -> None:
    try:
        if aside.is_dir() and not aside.is_symlink():
            aside.rename(path)
            return
        path.hardlink_to(aside)  # a rename would write over a newer one
    except OSError:  # made again meanwhile
        pass
    remove_path(aside)


def _cached(cache: Path) -> Iterator[CacheEntry]:
    for what, folder in _ENTRIES.items():
        if (cache / folder).is_dir():
            yield from (_seen(path, what) for path in sorted((cache / folder).iterdir()))


def _seen(path: Path, what: str) -> CacheEntry:
    found = _states(path)
    return CacheEntry(path, what, _part_bytes(found), max((_used_s(each) for each in found), default=0.0))


def _states(path: Path) -> list[os.stat_result]:
    """Returns what is known of a file, or of a folder and all that is in it; some of it may go meanwhile."""
    return [each for each in (_stat(path), *(_stat(Path(base, name)) for base, name in _names(path))) if each]


def _part_bytes(found: Iterable[os.stat_result]) -> int:
    """Returns how long files are together; of one that container images share, each has its part."""
    return sum(each.st_size // each.st_nlink for each in found if stat.S_ISREG(each.st_mode))


def _used_s(found: os.stat_result) -> float:
    # Reading a folder's names, as housekeeping does, is no use of what is in it.
    return found.st_mtime if stat.S_ISDIR(found.st_mode) else max(found.st_atime, found.st_mtime)


def _names(path: Path) -> Iterator[tuple[str, str]]:
    for base, folders, files in os.walk(path) if not path.is_symlink() else ():
        yield from ((base, name) for name in (*folders, *files))


def _stat(path: Path) -> os.stat_result | None:
    try:
        return path.lstat()
    except OSError:  # it went meanwhile, or lies in another account's folder
        return None


def remove_path(path: Path) -> None:
    """Removes a file, a link, or a folder whose own folders may be read-only.

    Another gc may remove it, too, or move it. Nothing behind a link is touched.
    """
    if path.is_symlink() or not path.is_dir():
        path.unlink(missing_ok=True)
        return
    for base, _, _ in os.walk(path):
        with suppress(FileNotFoundError):
            Path(base).chmod(0o755)
    shutil.rmtree(path, onerror=_raise_unless_gone)


def _raise_unless_gone(_function: object, _path: str, found: tuple[object, BaseException, object]) -> None:
    if not isinstance(found[1], FileNotFoundError):
        raise found[1]


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
    return MachineRow(
        what=what, place=str(path), owner=_owner(found.st_uid), bytes=_part_bytes(_states(path)), fate=fate
    )


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
    return DocumentError.of("SIMYARD_CACHE", value, allowed, source="simyard")
