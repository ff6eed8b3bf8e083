"""Accounts on a robot: that of its programs, and the rights in the store of an agent that is not the store's owner.

A robot's programs run under an account of their own, so that they cannot read their agent's environment and memory. An
agent of another account needs rights in a store that is a folder; docs/operate/robot.md lists them.
"""

import ctypes
import os
import pwd
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from specs.errors import DocumentError
from tasks.storage.backends.local import LOCKS, LocalStore
from tasks.storage.base.keys import STORE, reported_key
from tasks.storage.base.local_files import lone_writer, missing_right
from tasks.storage.base.store import Store

_SET_DUMPABLE = 4
_ROOT = 0
_DEFAULTS = ("simyard-app", "nobody")
_ANY = ".any"
REMEDY = "docs/operate/robot.md says what an agent of another account needs"


# An agent may hold the store's credentials in its environment, and a process may read that of another of the same
# account (proc(5), /proc/pid/environ). So an agent of root runs programs under an account of their own. Any other
# agent cannot do that; it makes itself undumpable instead (prctl(2), PR_SET_DUMPABLE), whereupon only root reads it.
@dataclass(frozen=True)
class Account:
    """An account other than the agent's.

    Attributes:
        name: What it is called, or its number.
        groups: All it is in, such as ``dialout``.
    """

    name: str
    uid: int
    gid: int
    groups: tuple[int, ...]


def chosen_account(user: str | None) -> Account | None:
    """Returns the account of the robot's programs; None for the agent's own.

    Args:
        user: Its name or number. None: for an agent of root ``simyard-app`` if there is one, else ``nobody``; for any
            other agent its own.

    Raises:
        DocumentError: There is no such account, or this agent is not root's and may not start programs under it.
    """
    if user is None:
        if os.geteuid() != _ROOT:
            return None
        user = next((name for name in _DEFAULTS if _is_account(name)), None)
        if user is None:
            raise _refused("", f"the name of an account; there is none of {', '.join(_DEFAULTS)}")
    account = _find(user)
    if account.uid == os.geteuid():
        return None
    if os.geteuid() != _ROOT:
        raise _refused(user, "this agent's own account: only an agent of root runs programs under another")
    return account


def make_home(account: Account, root: Path) -> Path:
    """Returns the folder below a robot's that its programs may write to, made for the account, and its HOME.

    The robot's folder gets entered by everybody, as far as it is this agent's to say.

    Raises:
        DocumentError: The account cannot get to the robot's folder.
    """
    os.umask(0o022)  # what is installed from now on is read by the account
    root.chmod(root.stat().st_mode & 0o777 | 0o011)
    home = root / "home"
    home.mkdir(mode=0o700, exist_ok=True)
    os.chown(home, account.uid, account.gid, follow_symlinks=False)
    if not _can_enter(account, home):
        otherwise = f"or --user {os.geteuid()}, and programs run as this agent does"
        allowed = f"a folder that the account {account.name!r} can get to; {otherwise}"
        raise DocumentError.of("--root", str(root), allowed, source="agent")
    return home


def let_add_files(account: Account, folder: Path) -> None:
    """Makes the account able to add files to a folder, but not to change, rename or remove what is there."""
    os.chown(folder, -1, account.gid)
    folder.chmod(0o1775)


def hide_memory() -> None:
    """Makes this process's environment and memory unreadable to others of its account; not to root."""
    if Path("/proc").is_dir():
        ctypes.CDLL(None).prctl(_SET_DUMPABLE, 0, 0, 0, 0)


def _find(user: str) -> Account:
    if re.fullmatch("[0-9]{1,9}", user):
        try:
            entry = pwd.getpwuid(int(user))
        except KeyError:  # as in a container
            return Account(user, int(user), int(user), ())
    else:
        try:
            entry = pwd.getpwnam(user)
        except KeyError as exc:
            raise _refused(user, "the name or number of an account of this machine") from exc
    return Account(entry.pw_name, entry.pw_uid, entry.pw_gid, tuple(os.getgrouplist(entry.pw_name, entry.pw_gid)))


def _is_account(name: str) -> bool:
    try:
        pwd.getpwnam(name)
    except KeyError:
        return False
    return True


def _can_enter(account: Account, folder: Path) -> bool:
    """Returns whether the account can get to a folder, as a process of it finds out."""
    pid = os.fork()
    if pid == 0:
        entered = 1
        try:
            os.setgroups(account.groups)
            os.setgid(account.gid)
            os.setuid(account.uid)
            os.chdir(folder)
            entered = 0
        finally:
            os._exit(entered)
    return os.waitpid(pid, 0)[1] == 0


def _refused(user: str, allowed: str) -> DocumentError:
    return DocumentError.of("--user", repr(user), allowed, source="agent")


def missing_rights(store: Store, robot: str) -> Iterator[str]:
    """Yields what this account lacks to be the agent of a robot, each with the command that gives it.

    Nothing of a robot that is not registered yet, and of a store that is no folder: only a request tells there.
    """
    if isinstance(store, LocalStore):
        written = [folder / _ANY for folder in _written(store, robot) if _is_there(folder)]
        lacks = [missing_right(store.root / STORE, replaced=False), *map(missing_right, written)]
        yield from dict.fromkeys(filter(None, lacks))


def silence_note(store: Store, robot: str) -> str:
    """Returns who alone may write where a robot reports, if that may be why nothing is heard of it; else nothing."""
    if not isinstance(store, LocalStore):
        return ""
    owners = {folder: lone_writer(folder) for folder in _written(store, robot)}
    told = " and ".join(f"only {owner} may write in {folder}" for folder, owner in owners.items() if owner)
    return f"{told}: {REMEDY}" if told else ""


def _written(store: LocalStore, robot: str) -> tuple[Path, Path]:
    return (store.root / reported_key(robot)).parent, store.root / LOCKS


def _is_there(folder: Path) -> bool:
    try:
        return folder.exists()
    except PermissionError:
        return True
