"""A full disk: how the system says so, and the message for a person: where, and how much room is left."""

import errno
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from specs.errors import StoreAccessDenied, StoreFull
from tasks.storage.base.cache_folder import cache_folder

NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
# What is no fault of what is written: the same bytes may be written when the disk is another.
OF_THE_DISK = NO_ROOM | {errno.EROFS, errno.EIO}
_MEBIBYTE = 1 << 20


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
