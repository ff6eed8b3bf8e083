"""Debian's PostgreSQL in a folder of its own, on a free port of this machine, never as root."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from tests.servers.ports import free_port
from tests.servers.tools import need_tool

_START_S = "60"
_INSTALLED = sorted(Path("/usr/lib/postgresql").glob("*/bin"))


@contextmanager
def running_postgres() -> Generator[int]:
    """Yields the port of a server with a database and a user, both named ``prefect``; skips the test without one."""
    programs = str(_INSTALLED[-1]) if _INSTALLED else None
    need_tool("initdb", "postgresql", path=programs)
    port = free_port()
    # Not in pytest's folder, which only its owner may enter: PostgreSQL refuses to run as root.
    folder = Path(tempfile.mkdtemp(prefix="simyard-postgres-"))
    user = "postgres" if os.geteuid() == 0 else None
    if user:
        shutil.chown(folder, user, user)

    def call(program: str, *arguments: str) -> None:
        subprocess.run([str(Path(programs or "") / program), *arguments], check=True, cwd=folder, user=user, group=user)

    data = str(folder / "data")
    options = f"-c listen_addresses=127.0.0.1 -p {port} -k {folder}"
    try:
        call("initdb", "--pgdata", data, "--auth", "trust", "--username", "prefect", "--no-sync")
        call("pg_ctl", "start", "-w", "-t", _START_S, "-D", data, "-l", str(folder / "log"), "-o", options)
        try:
            call("createdb", "--host", "127.0.0.1", "--port", str(port), "--username", "prefect", "prefect")
            yield port
        finally:
            call("pg_ctl", "stop", "-m", "immediate", "-D", data)
    finally:
        shutil.rmtree(folder)
