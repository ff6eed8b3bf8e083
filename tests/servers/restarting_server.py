"""A Prefect server that a test kills and starts again, at the same address and with the same database."""

import os
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from tasks.server.process import SERVER_ENVIRONMENT, Server, end, launch, wait_until_healthy


class RestartingServer:
    """A server in a folder; it runs from the beginning.

    Attributes:
        api_url: Where it answers, before and after.
        process: The server.
    """

    def __init__(self, home: Path) -> None:
        """Starts it and waits until it answers."""
        self._home = home
        self._server, self.process = launch(home, bound=True)
        self.api_url = self._server.api_url
        wait_until_healthy(self._server, self.process)

    def kill(self) -> None:
        """Ends it as a loss of power does."""
        self.process.kill()
        self.process.wait()

    def start_again(self) -> None:
        """Starts it with the database that it had; returns at once, it answers some seconds later."""
        port = self.api_url.rpartition(":")[2].partition("/")[0]
        program = [sys.executable, "-m", "tasks.server.guarded_server", port]
        own = {**self.environment(), "PREFECT_SERVER_API_AUTH_STRING": self._server.password}
        with Path(self._server.log).open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "tasks.server.bound_child", str(os.getpid()), *program],
                env={**os.environ, **SERVER_ENVIRONMENT, **own},
                stdout=log,
                stderr=log,
                stdin=subprocess.DEVNULL,
            )

    def wait(self) -> None:
        """Returns when it answers."""
        wait_until_healthy(Server(self.api_url, self.process.pid, self._server.log), self.process)

    def environment(self) -> dict[str, str]:
        """Returns what a process needs to use it."""
        return {**self._server.environment(), "PREFECT_HOME": str(self._home)}


@contextmanager
def restarting_server(home: Path) -> Generator[RestartingServer]:
    """Yields a server, and ends whichever runs at the end."""
    server = RestartingServer(home)
    try:
        yield server
    finally:
        end(server.process)
