"""Rights that an agent of another account needs in a store that is a folder; docs/operate/robot.md lists them."""

from collections.abc import Iterator
from pathlib import Path

from tasks.storage.backends.local import LOCKS, LocalStore
from tasks.storage.base.folder_rights import lone_writer, missing_right
from tasks.storage.base.keys import STORE, reported_key
from tasks.storage.base.store import Store

_ANY = ".any"
REMEDY = "docs/operate/robot.md says what an agent of another account needs"


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
