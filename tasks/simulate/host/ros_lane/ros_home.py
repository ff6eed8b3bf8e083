"""The folder that the nodes of a chunk write to: logs, temporary files. It is gone with the chunk.

A process that is killed cannot remove its folder. The next one that makes such a folder does: whose lock nobody holds
is nobody's.
"""

import fcntl
import os
import shutil
import tempfile
import time
from contextlib import suppress
from pathlib import Path

_PREFIX = "simyard-ros-"
# A folder is made first and locked then: one so young may be about to be locked.
_YOUNG_S = 60.0
_PRINTED_BYTES = 2000


class RosHome:
    """A folder for the nodes of a chunk, locked as long as this process lives.

    Attributes:
        path: The folder.
    """

    def __init__(self) -> None:
        """Makes it, and removes those that nobody has any more."""
        remove_abandoned(Path(tempfile.gettempdir()))
        self.path = Path(tempfile.mkdtemp(prefix=_PREFIX))
        self._handle = _locked(self.path)

    def printed(self, lane: int) -> str:
        """Returns what the nodes of a lane printed last, each under its name; empty if they printed nothing.

        Args:
            lane: Whose folder in this one is ``lane-<number>``, as lock-step makes it.
        """
        said: list[str] = []
        for path in sorted((self.path / f"lane-{lane}" / "log").glob("*.out")):
            with suppress(OSError), os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
                file.seek(max(0, os.fstat(file.fileno()).st_size - _PRINTED_BYTES))
                text = file.read(_PRINTED_BYTES).decode("utf-8", "replace").strip()
                said += [f"{path.stem}: {line}" for line in text.splitlines()]
        return "\n".join(said)

    def close(self) -> None:
        """Removes it with all that lies in it; a second call does nothing."""
        shutil.rmtree(self.path, ignore_errors=True)
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


def remove_abandoned(folder: Path) -> None:
    """Removes the folders of processes that were killed.

    Args:
        folder: Where they lie.
    """
    for path in folder.glob(f"{_PREFIX}*"):
        with suppress(OSError):
            if path.is_symlink() or time.time() - path.stat().st_mtime < _YOUNG_S:
                continue
            handle = _locked(path)
            if handle is not None:
                shutil.rmtree(path, ignore_errors=True)
                os.close(handle)


def _locked(path: Path) -> int | None:
    """Returns a handle on a folder that is locked as long as it is open; None if somebody else has locked it."""
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle
