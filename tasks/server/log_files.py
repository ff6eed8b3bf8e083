"""A log for each server that is started, and no more than a few of those that ended."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import IO

_ENDED_KEPT = 5


@contextmanager
def new_log(home: Path) -> Generator[IO[bytes], None, None]:
    """Yields a file for the output of a server whose number is not known yet; removes old logs."""
    _prune(home)
    with NamedTemporaryFile(dir=home, prefix="starting-", suffix=".log", delete=False) as output:
        try:
            yield output
        except BaseException:
            Path(output.name).unlink(missing_ok=True)
            raise


def rename_log(output: IO[bytes], pid: int) -> Path:
    """Returns the file of the log, which carries the server's process id in its name from now on."""
    before = Path(output.name)
    return before.rename(before.with_name(f"server-{pid}.log"))


def _prune(home: Path) -> None:
    ended = [log for log in home.glob("server-*.log") if not _runs(log.stem.removeprefix("server-"))]
    for log in sorted(ended, key=_written_s, reverse=True)[_ENDED_KEPT:]:
        log.unlink(missing_ok=True)


def _runs(pid: str) -> bool:
    return Path("/proc", pid).exists()


def _written_s(log: Path) -> float:
    try:
        return log.stat().st_mtime
    except FileNotFoundError:  # another start pruned it
        return 0.0
