"""Rights in a store's folder that several accounts share: which one is missing where, and what gives it.

docs/operate/robot.md says which rights an agent of another account needs. A folder whose group may write to it, and
hands itself on (setgid), is meant to be shared: what is made in it is its group's, whatever the umask of who makes it.
"""

import grp
import os
import pwd
import shlex
import stat
from pathlib import Path

_SHARED = stat.S_ISGID | stat.S_IWGRP
_FILE_OF_GROUP = stat.S_IRGRP | stat.S_IWGRP
_FOLDER_OF_GROUP = _FILE_OF_GROUP | stat.S_IXGRP | stat.S_ISGID


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
        folder.chmod(stat.S_IMODE(folder.stat().st_mode) | _FOLDER_OF_GROUP)


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
