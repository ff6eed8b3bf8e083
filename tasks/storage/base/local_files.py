"""Files of this machine: the cache folder, rights of shared folders, files that appear whole, room on the disk."""

import errno
import grp
import os
import pwd
import shlex
import shutil
import stat
import tempfile
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from specs.errors import StoreAccessDenied, StoreFull

_SHARED = stat.S_ISGID | stat.S_IWGRP
_FILE_OF_GROUP = stat.S_IRGRP | stat.S_IWGRP
_FOLDER_OF_GROUP = _FILE_OF_GROUP | stat.S_IXGRP | stat.S_ISGID
HIDDEN = ".tmp-"
_EVERYBODYS = 0o666
NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
# What is no fault of what is written: the same bytes may be written when the disk is another.
OF_THE_DISK = NO_ROOM | {errno.EROFS, errno.EIO}
_MEBIBYTE = 1 << 20
_HELD = "/proc/self/fd/"
_PASSED = os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC


def cache_folder() -> Path:
    """Returns SIMYARD_CACHE, else ``simyard`` in the user's cache folder (XDG base directory specification)."""
    return chosen_folder(os.environ)


def chosen_folder(environment: Mapping[str, str]) -> Path:
    """Returns the cache folder of a process with these variables."""
    chosen = environment.get("SIMYARD_CACHE")
    if chosen:
        return Path(chosen)
    home = environment.get("HOME") or Path.home()
    return Path(environment.get("XDG_CACHE_HOME") or Path(home) / ".cache") / "simyard"


# docs/operate/robot.md says which rights an agent of another account needs. A folder whose group may write to it, and
# hands itself on (setgid), is meant to be shared: what is made in it is its group's, whatever the umask of who makes
# it.
def missing_right(path: Path, *, replaced: bool = True) -> str:
    """Returns which right this account lacks to read a file, and to replace it, and the command that gives it.

    The first folder on the way is named that lacks one. The text is empty if no bit of a mode explains the refusal.

    Args:
        path: The file, which need not be there.
        replaced: Whether it is to be replaced, and not only read.
    """
    for folder in reversed(path.parents):
        if not os.path.lexists(folder):
            break
        if not _may(folder, os.X_OK):
            return _lack("enter", folder, f"chmod o+x {shlex.quote(str(folder))}")
    if os.path.lexists(path) and not _may(path, os.R_OK):
        return _lack("read", path, _for_group(path, "g+rx" if path.is_dir() else "g+r"))
    there = next(folder for folder in path.parents if folder.exists())
    return "" if not replaced or _may(there, os.W_OK) else _lack("write in", there, _for_group(there, "g+rwxs"))


def share_file(descriptor: int, folder: Path) -> None:
    """Lets the group of a shared folder read and write a new file of it."""
    if is_shared(folder):
        os.fchmod(descriptor, stat.S_IMODE(os.fstat(descriptor).st_mode) | _FILE_OF_GROUP)


def share_folder(folder: Path) -> None:
    """Lets the group of a shared folder write to a new folder in it."""
    if is_shared(folder.parent):
        # Not by its name: another of the group may have put a link there meanwhile.
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        try:
            os.fchmod(descriptor, stat.S_IMODE(os.fstat(descriptor).st_mode) | _FOLDER_OF_GROUP)
        finally:
            os.close(descriptor)


def is_shared(folder: Path) -> bool:
    """Returns whether a folder's group may write to it and to what is made in it."""
    return folder.stat().st_mode & _SHARED == _SHARED


def lone_writer(folder: Path) -> str:
    """Returns the account that alone may write to a folder; empty if others may, or none can be told."""
    try:
        found = folder.stat()
    except OSError:
        return ""
    return "" if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH) else _account(found.st_uid)


def _lack(what: str, path: Path, command: str) -> str:
    found = path.stat()
    mode = stat.filemode(found.st_mode)[1:]
    whose = f"which is {_account(found.st_uid)}'s ({mode}, group {_group(found.st_gid)})"
    return f"{_account(os.geteuid())} may not {what} {path}, {whose}; as root: {command}"


def _for_group(path: Path, bits: str) -> str:
    quoted = shlex.quote(str(path))
    return f"chgrp {_group(os.getegid())} {quoted} && chmod {bits} {quoted}"


def _may(path: Path, how: int) -> bool:
    return os.access(path, how, effective_ids=os.access in os.supports_effective_ids)


def _account(number: int) -> str:
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return str(number)


def _group(number: int) -> str:
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)


# A file is written under a hidden name in the folder where it will stand, flushed to the disk, and only then given
# its name by one link or rename, which is flushed in turn.
@contextmanager
def hidden_file(folder: Path, mark: str = "", mode: int = _EVERYBODYS) -> Generator[tuple[BinaryIO, Path]]:
    """Makes a file under a hidden name, which begins with ``HIDDEN`` and the mark, and removes that name at the end.

    The caller writes, calls ``flush_to_disk``, and links or renames; a writer that is killed leaves a name that starts
    with a dot, which no store lists.
    """
    make_folder(folder)
    path = folder / f"{HIDDEN}{mark}{uuid4().hex}"
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
    try:
        with os.fdopen(descriptor, "wb") as file:
            if mode == _EVERYBODYS:
                share_file(descriptor, folder)
            yield file, path
    finally:
        path.unlink(missing_ok=True)


@contextmanager
def whole_file(target: Path, mode: int = 0o666) -> Generator[BinaryIO]:
    """Opens a file for writing that replaces ``target`` when the block ends, and leaves it alone when it raises.

    Args:
        target: The file.
        mode: Who may do what with it, less this process's umask, whatever the old file's was.
    """
    with hidden_file(target.parent, mode=mode) as (file, path):
        yield file
        flush_to_disk(file)
        path.replace(target)
    settle_names(target.parent)


def flush_to_disk(file: BinaryIO) -> None:
    """Waits until the file's bytes are on the disk."""
    file.flush()
    os.fsync(file.fileno())


def settle_names(folder: Path) -> None:
    """Waits until the names in the folder are on the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def make_folder(folder: Path) -> None:
    """Makes the folder and those above it, each settled in the one that holds it."""
    if folder.is_dir():
        return
    make_folder(folder.parent)
    try:
        folder.mkdir()
    except FileExistsError:
        if not folder.is_dir():
            raise
    else:
        share_folder(folder)
    settle_names(folder.parent)


# Whoever may write into a folder may put a link into it that leads elsewhere, also between a look and what follows. So
# each folder on the way is opened from the one before, and what is done is done in what was opened: the kernel finds it
# by its descriptor, whatever its names lead to by then.
@contextmanager
def held_folder(top: Path, below: str, *, make: bool = False) -> Generator[Path]:
    """Yields a path that leads to this very folder inside the ``with`` block; no link below the top was followed.

    Args:
        top: A folder of the owner's: it and those above it may be links.
        below: Where the folder is from there; empty for the top itself.
        make: Whether to make what is not there.

    Raises:
        OSError: ELOOP if there is a link on the way, ENOSYS where /proc is not mounted.
    """
    if not os.path.isdir(_HELD):  # noqa: PTH112 - each read and write asks; folders would be made in its place
        raise OSError(errno.ENOSYS, "/proc is not mounted; a store in a folder needs it", str(top))
    if make:
        make_folder(top)
    held = os.open(top, _PASSED)
    try:
        for name in below.split("/") if below else ():
            passed, held = held, _entered(f"{_HELD}{held}/{name}", make=make)
            os.close(passed)
        yield Path(f"{_HELD}{held}")
    except OSError as exc:
        if isinstance(exc.filename, str) and exc.filename.startswith(_HELD):
            number, _, rest = exc.filename.removeprefix(_HELD).partition("/")
            exc.filename = str(Path(f"{_HELD}{number}").readlink() / rest)
        raise
    finally:
        os.close(held)


def _entered(folder: str, *, make: bool) -> int:
    try:
        return os.open(folder, _PASSED | os.O_NOFOLLOW)
    except FileNotFoundError:
        if not make:
            raise
        make_folder(Path(folder))
        return os.open(folder, _PASSED | os.O_NOFOLLOW)
    except NotADirectoryError as exc:
        if Path(folder).is_symlink():
            raise OSError(errno.ELOOP, "a link where a folder belongs", folder) from exc
        raise


def full_disk_message(exc: OSError, folder: Path) -> str:
    """Returns why there was no room, and how much there is, in one line.

    Args:
        exc: What the system said.
        folder: Where it was to be written; it need not be there yet.
    """
    return f"{exc.strerror}: {_room(folder)}; make room and try again"


def full_machine_message(exc: OSError) -> str:
    """Returns that a disk of this machine has no room, where the system does not say which one."""
    places = (Path(tempfile.gettempdir()), cache_folder())
    return f"{exc.strerror}: {', '.join(map(_room, places))}; make room and run the same command again"


def _room(folder: Path) -> str:
    place = next((each for each in (folder, *folder.parents) if each.is_dir()), Path("/"))
    usage = shutil.disk_usage(place)
    return f"{folder} has {usage.free / _MEBIBYTE:.1f} MiB free of {usage.total / _MEBIBYTE:.1f} MiB"


@contextmanager
def room_in(folder: Path) -> Generator[None]:
    """Tells a full or read-only disk of this machine as what it is, inside the ``with`` block.

    Raises:
        StoreFull: There is no room in the folder.
        StoreAccessDenied: Its disk is mounted read-only.
    """
    try:
        yield
    except OSError as exc:
        if exc.errno in NO_ROOM:
            raise StoreFull(full_disk_message(exc, folder)) from exc
        if exc.errno == errno.EROFS:
            raise StoreAccessDenied(f"{exc.strerror}: {folder}; make it writable") from exc
        raise
