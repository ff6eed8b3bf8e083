"""Prefect servers as child processes: chosen, started, waited for and ended, without importing Prefect."""

import fcntl
import logging
import os
import socket
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import NamedTemporaryFile
from threading import Thread
from typing import IO
from urllib.parse import urlsplit

from specs.errors import StageFailed
from tasks.server.health import is_healthy, is_port_free, new_password, private_file
from tasks.storage.base.proxies import proxy_exceptions, without_useless_proxies

logger = logging.getLogger(__name__)

LOCK = "starting.lock"
_INTERVAL_S = 0.1
_ENDED_KEPT = 5
# An offline machine must not log telemetry errors, and a cold one needs longer than Prefect's 20 s
# (docs/reference/prefect.md, section 2).
SERVER_ENVIRONMENT = {
    "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
    "DO_NOT_TRACK": "1",
    "PREFECT_SERVER_EPHEMERAL_STARTUP_TIMEOUT_SECONDS": "180",
}
# Prefect lists the types of its blocks when it starts, and imports each installed collection (Dask, Ray) for that. A
# program that saves a block registers its type itself; only the pages show the list, and a server of one run has none.
_NO_BLOCK_TYPES = {
    "PREFECT_SERVER_REGISTER_BLOCKS_ON_START": "false",
    "PREFECT_SERVER_MEMOIZE_BLOCK_AUTO_REGISTRATION": "false",  # else they are imported to be compared
}
# With these `prefect deployment run --watch` shows what a flow run logs, its verdict at last; Prefect has them off.
_STREAMED_LOGS = {
    "PREFECT_SERVER_LOGS_STREAM_OUT_ENABLED": "true",
    "PREFECT_SERVER_LOGS_STREAM_PUBLISHING_ENABLED": "true",
}
START_TIMEOUT_S = 180.0
_LOOK_S = 0.05
PRESTARTED = "--reserve"
"""After a server's port: it only imports until its input says that it starts."""


def take_turn(home: Path, timeout_s: float) -> IO[bytes]:
    """Returns the lock of a database's folder, held; closing it, or the end of this process, lets the next one start.

    Args:
        home: The folder; made where it is missing.
        timeout_s: How long to wait for another's start. It has failed by then, so this one goes ahead beside it.
    """
    home.mkdir(mode=0o700, parents=True, exist_ok=True)
    lock = (home / LOCK).open("ab")
    deadline_s = time.monotonic() + timeout_s
    while not _held(lock):
        if time.monotonic() > deadline_s:
            logger.warning("another start took longer than %.0f s; starting beside it", timeout_s)
            break
        time.sleep(_INTERVAL_S)
    return lock


def end_turn_when(lock: IO[bytes], started: Callable[[], bool], timeout_s: float) -> None:
    """Closes the lock, from a thread, once a start is over or has taken so many seconds."""

    def wait() -> None:
        deadline_s = time.monotonic() + timeout_s
        with lock:
            while time.monotonic() < deadline_s and not started():
                time.sleep(_INTERVAL_S)

    Thread(target=wait, name="simyard start", daemon=True).start()


def _held(lock: IO[bytes]) -> bool:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


@contextmanager
def new_log(home: Path) -> Generator[IO[bytes], None, None]:
    """Yields a file for the output of a server whose number is not known yet; removes old logs."""
    ended = [log for log in home.glob("server-*.log") if not _runs(log.stem.removeprefix("server-"))]
    for log in sorted(ended, key=_written_s, reverse=True)[_ENDED_KEPT:]:
        log.unlink(missing_ok=True)
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


def _runs(pid: str) -> bool:
    return Path("/proc", pid).exists()


def _written_s(log: Path) -> float:
    try:
        return log.stat().st_mtime
    except FileNotFoundError:  # another start pruned it
        return 0.0


@dataclass(frozen=True)
class Server:
    """A Prefect server process.

    Attributes:
        api_url: What PREFECT_API_URL is to be.
        pid: Its process id.
        log: Where its output goes.
        password: What PREFECT_API_AUTH_STRING is to be; empty if it asks for none.
        notice: What to tell who started it; empty if nothing.
    """

    api_url: str
    pid: int
    log: str
    password: str = field(default="", repr=False, compare=False)
    notice: str = field(default="", compare=False)

    def environment(self) -> dict[str, str]:
        """Returns the variables by which Prefect's client reaches the server."""
        return {"PREFECT_API_URL": self.api_url, "PREFECT_API_AUTH_STRING": self.password}


_waiting: dict[Path, tuple[Server, subprocess.Popen[bytes]]] = {}  # in reserve, by their folders


def configured(environment: Mapping[str, str], name: str) -> str:
    """Returns what the user chose for Prefect: a variable, or the active Prefect profile's, or nothing.

    Args:
        environment: Of this process.
        name: Such as PREFECT_API_URL, the server.
    """
    chosen = environment.get(name)
    if chosen:
        return chosen
    home = Path(environment.get("PREFECT_HOME", Path.home() / ".prefect"))
    try:
        profiles = tomllib.loads((home / "profiles.toml").read_text())
    except (OSError, tomllib.TOMLDecodeError):  # what hinders Prefect itself, it says
        return ""
    active = environment.get("PREFECT_PROFILE", profiles.get("active", ""))
    value = profiles.get("profiles", {}).get(active, {}).get(name)
    return value if isinstance(value, str) else ""


def launch(
    home: Path, *, bound: bool, port: int = 0, in_reserve: bool = False
) -> tuple[Server, subprocess.Popen[bytes]]:
    """Starts a server on 127.0.0.1 and returns it at once; it is not healthy yet.

    Args:
        home: Folder for its database and log.
        bound: Whether it is for this process alone, and the kernel ends it with this process; otherwise it stays.
        port: Where it listens; 0 for any free port.
        in_reserve: Whether it imports what it needs, and no more until it is called up.
    """
    home.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not in_reserve:
        _close_database(home)
    port, password = port or _free_port(), new_password()
    command = [sys.executable, "-m", "tasks.server.guarded_server", str(port), *([PRESTARTED] if in_reserve else [])]
    if bound:
        command = [sys.executable, "-m", "tasks.server.bound_child", str(os.getpid()), *command]
    url = f"http://127.0.0.1:{port}/api"
    environment = {
        **without_useless_proxies(os.environ),
        **SERVER_ENVIRONMENT,
        **proxy_exceptions(os.environ),
        **_own_settings(home, port),
        **(_NO_BLOCK_TYPES if bound else _STREAMED_LOGS),
        "PREFECT_API_AUTH_STRING": password,
        "PREFECT_SERVER_API_AUTH_STRING": password,
    }
    with new_log(home) as output:
        process = subprocess.Popen(  # noqa: S603 - a list built here, no shell
            command,
            stdout=output,
            stderr=subprocess.STDOUT,
            stdin=subprocess.PIPE if in_reserve else subprocess.DEVNULL,
            env=environment,
            start_new_session=True,
        )
    log = str(rename_log(output, process.pid))
    return Server(api_url=url, pid=process.pid, log=log, password=password), process


def wait_until_healthy(server: Server, process: subprocess.Popen[bytes], timeout_s: float = START_TIMEOUT_S) -> None:
    """Returns once the server answers.

    Raises:
        StageFailed: It ended, or does not answer in time; the reason names its log.
    """
    deadline = time.monotonic() + timeout_s
    while not is_healthy(server.api_url):
        if process.poll() is not None:
            raise StageFailed(
                "InternalServiceError", f"the Prefect server ended with {process.returncode}: {server.log}"
            )
        if time.monotonic() > deadline:
            raise StageFailed(
                "InternalServiceError", f"the Prefect server is silent after {timeout_s:.0f} s: {server.log}"
            )
        time.sleep(_LOOK_S)


@contextmanager
def reserve_server(home: Path) -> Generator[None, None, None]:
    """Has a server for the block import what it needs, before it is known whether the block runs one.

    ``run_server`` calls it up. Before that it touches no database and listens nowhere; it ends with the block, or with
    this process, if nobody has called it up.

    Args:
        home: Folder for its database and log.
    """
    with suppress(OSError):  # who runs one says what hinders it
        _waiting[home] = launch(home, bound=True, in_reserve=True)
    try:
        yield
    finally:
        if home in _waiting:
            _dismiss(*_waiting.pop(home))


def _called_up(home: Path) -> tuple[Server, subprocess.Popen[bytes]] | None:
    """Returns the server in reserve, which starts now; None if there is none, or it has ended."""
    if home not in _waiting:
        return None
    _close_database(home)
    server, process = _waiting.pop(home)
    assert process.stdin is not None  # noqa: S101 - asked for
    # Its port was chosen before another run's start was waited for, and nobody has held it since.
    if is_port_free(urlsplit(server.api_url).port or 0):
        with suppress(OSError):  # it has ended
            with process.stdin as line:
                line.write(b"\n")
            if process.poll() is None:
                return server, process
    _dismiss(server, process)
    return None


def _dismiss(server: Server, process: subprocess.Popen[bytes]) -> None:
    """Ends a server that was not called up: it has done nothing."""
    process.kill()
    with suppress(OSError):
        if process.stdin:
            process.stdin.close()
    process.wait()
    Path(server.log).unlink(missing_ok=True)


@contextmanager
def run_server(home: Path) -> Generator[tuple[Server, subprocess.Popen[bytes]], None, None]:
    """Runs a server for the length of a ``with`` block, the one in reserve if there is one; it starts meanwhile.

    Another start on the same folder is waited for, and has to wait until this server is healthy or dead.
    """
    lock = take_turn(home, START_TIMEOUT_S)
    try:
        server, process = _called_up(home) or launch(home, bound=True)
    except BaseException:
        lock.close()
        raise
    end_turn_when(lock, lambda: process.poll() is not None or is_healthy(server.api_url), START_TIMEOUT_S)
    try:
        yield server, process
    finally:
        end(process)


def has_database(home: Path) -> bool:
    """Returns whether a server's folder has its database; to make it, the first server takes seconds."""
    try:
        return (home / "prefect.db").stat().st_size > 0
    except OSError:
        return False


def end(process: subprocess.Popen[bytes], timeout_s: float = 10.0) -> None:
    """Ends a server: politely, then not."""
    process.terminate()
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        logger.warning("the Prefect server ignored SIGTERM for %.0f s; killing it", timeout_s)
        process.kill()
        process.wait()


def _own_settings(home: Path, port: int) -> dict[str, str]:
    return {
        "PREFECT_HOME": str(home),
        "PREFECT_API_URL": f"http://127.0.0.1:{port}/api",
        "PREFECT_SERVER_API_HOST": "127.0.0.1",
        "PREFECT_SERVER_API_PORT": str(port),
        # The page at localhost asks 127.0.0.1: to a browser that is another origin.
        "PREFECT_SERVER_CORS_ALLOWED_ORIGINS": f"http://127.0.0.1:{port},http://localhost:{port}",
    }


def _close_database(home: Path) -> None:
    """Makes Prefect's database readable for its owner only; SQLite gives what it writes beside it the same rights."""
    private_file(home / "prefect.db")
    for path in home.glob("prefect.db-*"):
        path.chmod(0o600)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
