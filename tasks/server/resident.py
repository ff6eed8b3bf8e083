"""A server that stays: noted in a file as soon as it is launched, so that it is found and ended whatever happens."""

import fcntl
import hashlib
import os
import random
import signal
import subprocess
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import IO

from pydantic import ValidationError

from specs.base import Spec
from specs.errors import StageFailed
from tasks.server.health import is_healthy, is_port_free, password_file, read_password, succeeds_within, write_password
from tasks.server.process import START_TIMEOUT_S, Server, end, launch, take_turn, wait_until_healthy
from tasks.storage.jobs.claim import ProcessIdentity, is_known_dead, process_of, this_process

_SILENT_S = 30.0
_CHECKOUT, _PORT = "checkout", "port"
_LOWEST_PORT, _HIGHEST_PORT = 1024, 65535
_PORTS = range(20_000, 30_000)
# Handles of kept servers that this very process started: it has to reap them when it ends them.
_started_here: dict[int, subprocess.Popen[bytes]] = {}


class _Note(Spec):
    """The kept server; ``process`` tells it from a later process that was given its number."""

    api_url: str
    pid: int
    log: str
    process: ProcessIdentity


def keep_server(home: Path) -> Server:
    """Starts a server that stays, or returns the one that is kept already.

    Raises:
        StageFailed: It does not come up, or the kept one does not answer.
    """
    with take_turn(home, START_TIMEOUT_S):
        kept = kept_server(home)
        if kept is not None:
            return kept
        port, notice = lasting_port(home)
        server, process = launch(home, bound=False, port=port)
        try:
            _write(home, server)
            wait_until_healthy(server, process)
        except BaseException:
            end(process)
            _forget(home)
            raise
        remember_port(home, port)
        _started_here[server.pid] = process
        return replace(server, notice=notice)


def checkout_home(cache: Path, checkout: Path) -> Path:
    """Returns the folder of a checkout's own Prefect server: ``prefect`` for the first one, another for each other.

    A server of one checkout shows and serves the runs of that one alone; two that share a cache folder may have
    different versions of Prefect, and different deployments.

    Args:
        cache: The cache folder, which checkouts of one account share.
        checkout: Where the code is.
    """
    first = cache / "prefect"
    other = cache / f"prefect-{hashlib.sha256(str(checkout).encode()).hexdigest()[:8]}"
    try:
        first.mkdir(mode=0o700, parents=True, exist_ok=True)
        with (first / _CHECKOUT).open("a+") as marker:
            owner = _owner(marker, "" if other.is_dir() else str(checkout))
    except OSError:  # a home that is read-only has no server; who starts one there is told
        return first
    return first if owner == str(checkout) else other


def _owner(marker: IO[str], heir: str) -> str:
    """Returns the checkout that a home is of.

    Args:
        marker: Says so.
        heir: Whose it becomes if it is nobody's, or of a checkout that is gone; empty for one that has a home, in which
            its server may run.
    """
    fcntl.flock(marker, fcntl.LOCK_EX)
    marker.seek(0)
    owner = marker.read()
    if not heir or (owner and Path(owner).is_dir()):
        return owner
    marker.truncate(0)
    marker.write(heir)
    return heir


def lasting_port(home: Path) -> tuple[int, str]:
    """Returns the port for a server that stays, the one that it had before if that is free, and what to say of it.

    Pages, profiles of Prefect and workers name the port. A new one is chosen below those that the system hands out.
    """
    try:
        before = int((home / _PORT).read_text())
    except (FileNotFoundError, ValueError):
        before = 0
    known = _LOWEST_PORT <= before <= _HIGHEST_PORT
    if known and is_port_free(before):
        return before, ""
    port = next(filter(is_port_free, random.sample(_PORTS, len(_PORTS))), 0)
    moved = (
        f"another program has port {before}, which this server had: open pages, profiles and workers need the new one"
    )
    return port, moved if known else ""


def remember_port(home: Path, port: int) -> None:
    """Notes the port of a server that stays, for its next start."""
    home.mkdir(mode=0o700, parents=True, exist_ok=True)
    (home / _PORT).write_text(str(port))


def kept_server(home: Path, silent_s: float = _SILENT_S) -> Server | None:
    """Returns the server that ``keep`` started, or None when it has ended.

    Args:
        home: Folder of its database.
        silent_s: How long one that runs may be silent: it is starting, or busy.

    Raises:
        StageFailed: It runs and stays silent; a second one must not work on its database.
    """
    note = _read(home)
    if note is None or is_known_dead(note.process):
        return None
    if not _runs_here(note):
        return _server(home, note) if is_healthy(note.api_url) else None
    if succeeds_within(lambda: is_healthy(note.api_url) or is_known_dead(note.process), silent_s):
        return None if is_known_dead(note.process) else _server(home, note)
    reason = f"the kept Prefect server, process {note.pid}, is silent; end it with simyard down. Log: {note.log}"
    raise StageFailed("InternalServiceError", reason)


def kept_process(home: Path) -> int:
    """Returns the number of the kept server's process; 0 if none is kept, or it does not run on this machine."""
    note = _read(home)
    return note.pid if note is not None and _runs_here(note) else 0


def is_kept_elsewhere(home: Path) -> bool:
    """Returns whether a server is noted that may run on another machine, which shares the folder."""
    note = _read(home)
    return note is not None and not _runs_here(note) and not is_known_dead(note.process)


def end_kept(home: Path, timeout_s: float = 20.0) -> Server | None:
    """Ends the kept server, also one that does not answer, and returns it; None when there is none."""
    note = _read(home)
    _forget(home)
    if note is None or not _runs_here(note):
        return None
    _signal(note, signal.SIGTERM)
    if not succeeds_within(lambda: is_known_dead(note.process), timeout_s, pause_s=0.1):
        _signal(note, signal.SIGKILL)
    if note.pid in _started_here:
        _started_here.pop(note.pid).wait()
    return Server(api_url=note.api_url, pid=note.pid, log=note.log)


def _runs_here(note: _Note) -> bool:
    """Returns whether the server is certainly a live process of this very machine."""
    return bool(note.process.started) and note.process.host == this_process().host and not is_known_dead(note.process)


def _signal(note: _Note, number: signal.Signals) -> None:
    with suppress(ProcessLookupError):
        os.kill(note.pid, number)


def kept_password(home: Path, api_url: str) -> str:
    """Returns the password of the server that stays, if that is the one at a URL; nothing for any other.

    Raises:
        StageFailed: Others can read it.
    """
    note = _read(home)
    return read_password(home) if note is not None and note.api_url == api_url else ""


def _server(home: Path, note: _Note) -> Server:
    return Server(api_url=note.api_url, pid=note.pid, log=note.log, password=read_password(home))


def _forget(home: Path) -> None:
    _file(home).unlink(missing_ok=True)
    password_file(home).unlink(missing_ok=True)


def _write(home: Path, server: Server) -> None:
    write_password(home, server.password)
    note = _Note(api_url=server.api_url, pid=server.pid, log=server.log, process=process_of(server.pid))
    _file(home).write_text(note.model_dump_json())


def _read(home: Path) -> _Note | None:
    try:
        return _Note.model_validate_json(_file(home).read_bytes())
    except (FileNotFoundError, ValidationError):
        return None


def _file(home: Path) -> Path:
    return home / "kept.json"
