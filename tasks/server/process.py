"""Starting, finding and ending Prefect servers, without importing Prefect."""

import json
import logging
import os
import signal
import socket
import subprocess
import sys
import time
import tomllib
import urllib.error
import urllib.request
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from specs.errors import StageFailed

logger = logging.getLogger(__name__)

# An offline machine must not log telemetry errors, and a cold one needs longer than Prefect's 20 s (orchestration.md).
SERVER_ENVIRONMENT = {
    "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
    "DO_NOT_TRACK": "1",
    "PREFECT_SERVER_EPHEMERAL_STARTUP_TIMEOUT_SECONDS": "180",
}
START_TIMEOUT_S = 180.0
# Handles of kept servers that this very process started: it has to reap them when it ends them.
_started_here: dict[int, subprocess.Popen[bytes]] = {}


@dataclass(frozen=True)
class Server:
    """A Prefect server process.

    Attributes:
        api_url: What PREFECT_API_URL is to be.
        pid: Its process id.
        log: Where its output goes.
    """

    api_url: str
    pid: int
    log: str


def configured_api_url(environment: Mapping[str, str]) -> str | None:
    """Returns the server that the user chose: PREFECT_API_URL, or the active Prefect profile's, or None."""
    chosen = environment.get("PREFECT_API_URL")
    if chosen:
        return chosen
    home = Path(environment.get("PREFECT_HOME", Path.home() / ".prefect"))
    try:
        profiles = tomllib.loads((home / "profiles.toml").read_text())
    except (FileNotFoundError, tomllib.TOMLDecodeError):
        return None
    active = environment.get("PREFECT_PROFILE", profiles.get("active", ""))
    value = profiles.get("profiles", {}).get(active, {}).get("PREFECT_API_URL")
    return value if isinstance(value, str) else None


def is_healthy(api_url: str, timeout_s: float = 1.0) -> bool:
    """Returns whether a Prefect server answers at the URL."""
    try:
        with urllib.request.urlopen(f"{api_url}/health", timeout=timeout_s) as reply:  # noqa: S310 - http by construction
            return reply.status == 200
    except (urllib.error.URLError, OSError):
        return False


def launch(home: Path, *, bound: bool) -> tuple[Server, subprocess.Popen[bytes]]:
    """Starts a server on a free port of 127.0.0.1 and returns it at once; it is not healthy yet.

    Args:
        home: Folder for its database and log.
        bound: Whether the kernel ends it with this process; otherwise it stays.
    """
    home.mkdir(parents=True, exist_ok=True)
    port = _free_port()
    log = home / "server.log"
    program = [str(Path(sys.executable).with_name("prefect")), "server", "start", "--host", "127.0.0.1"]
    command = [*program, "--port", str(port)]
    if bound:
        command = [sys.executable, "-m", "tasks.server.bound_child", str(os.getpid()), *command]
    url = f"http://127.0.0.1:{port}/api"
    environment = {**os.environ, **SERVER_ENVIRONMENT, "PREFECT_HOME": str(home), "PREFECT_API_URL": url}
    with log.open("wb") as output:
        process = subprocess.Popen(  # noqa: S603 - a list built here, no shell
            command,
            stdout=output,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            env=environment,
            start_new_session=True,
        )
    return Server(api_url=url, pid=process.pid, log=str(log)), process


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
        time.sleep(0.1)


@contextmanager
def serving(home: Path) -> Generator[tuple[Server, subprocess.Popen[bytes]], None, None]:
    """Runs a server for the length of a ``with`` block; it starts while the block's first lines run."""
    server, process = launch(home, bound=True)
    try:
        yield server, process
    finally:
        _end(process)


def keep(home: Path) -> Server:
    """Starts a server that stays, or returns the one that is kept already.

    Raises:
        StageFailed: It does not come up.
    """
    kept = kept_server(home)
    if kept is not None:
        return kept
    server, process = launch(home, bound=False)
    _started_here[server.pid] = process
    wait_until_healthy(server, process)
    _note(home).write_text(json.dumps(asdict(server)))
    return server


def kept_server(home: Path) -> Server | None:
    """Returns the server that ``keep`` started, if it still answers."""
    try:
        server = Server(**json.loads(_note(home).read_text()))
    except (FileNotFoundError, json.JSONDecodeError, TypeError):
        return None
    return server if is_healthy(server.api_url) else None


def end_kept(home: Path, timeout_s: float = 20.0) -> Server | None:
    """Ends the kept server and returns it, or returns None when there is none."""
    server = kept_server(home)
    _note(home).unlink(missing_ok=True)
    if server is None:
        return None
    os.kill(server.pid, signal.SIGTERM)
    if server.pid in _started_here:
        _started_here.pop(server.pid).wait(timeout_s)
    deadline = time.monotonic() + timeout_s
    while is_healthy(server.api_url) and time.monotonic() < deadline:
        time.sleep(0.1)
    return server


def _end(process: subprocess.Popen[bytes], timeout_s: float = 10.0) -> None:
    process.terminate()
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        logger.warning("the Prefect server ignored SIGTERM for %.0f s; killing it", timeout_s)
        process.kill()
        process.wait()


def _note(home: Path) -> Path:
    return home / "kept.json"


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
