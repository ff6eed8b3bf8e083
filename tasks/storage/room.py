"""A disk without room: how the system says so, and what a person is told: where, and how much is left."""

import errno
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from specs.errors import StoreAccessDenied, StoreFull

NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
# What is no fault of what is written: the same bytes may be written when the disk is another.
OF_THE_DISK = NO_ROOM | {errno.EROFS, errno.EIO}
_MEBIBYTE = 1 << 20


def told_full(exc: OSError, folder: Path) -> str:
    """Returns why there was no room, and how much there is, in one line.

    Args:
        exc: What the system said.
        folder: Where it was to be written; it need not be there yet.
    """
    place = next((each for each in (folder, *folder.parents) if each.is_dir()), Path("/"))
    usage = shutil.disk_usage(place)
    free, total = usage.free / _MEBIBYTE, usage.total / _MEBIBYTE
    return f"{exc.strerror}: {folder} has {free:.1f} MiB free of {total:.1f} MiB; make room and try again"


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
            raise StoreFull(told_full(exc, folder)) from exc
        if exc.errno == errno.EROFS:
            raise StoreAccessDenied(f"{exc.strerror}: {folder}; make it writable") from exc
        raise
