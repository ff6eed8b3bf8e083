"""Whether something on this machine is certainly Simyard's, so that it may be removed; else why it stays."""

import os
import re
import stat
import time
from collections.abc import Iterator
from pathlib import Path

GOES = "goes"
UNKNOWN = "stays: not known to be Simyard's"
LINK = "stays: a link"
MOUNTED = "stays: something is mounted in it"
_MOUNTS = Path("/proc/self/mountinfo")
_ESCAPE = re.compile(r"\\([0-7]{3})")
_YOUNG_S = 86_400.0


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
