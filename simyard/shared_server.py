"""The Prefect server of the runs of this process: found or started by the first, and ended after the last of them.

A thread of its own holds it: the server is bound to the thread that started it, and callers' threads may end in any
order.
"""

import os
from collections.abc import Generator
from contextlib import contextmanager
from threading import Event, Lock, Thread

_VARIABLES = ("PREFECT_API_URL", "PREFECT_API_AUTH_STRING", "PREFECT_HOME", "PREFECT_CLIENT_MAX_RETRIES")
_one_counts = Lock()


class Holder:
    """A thread that holds the server for as long as somebody uses it."""

    def __init__(self) -> None:
        self.users = 0
        self.variables: dict[str, str] = {}
        self._failure: BaseException | None = None
        self._ready, self._unused = Event(), Event()
        self._thread = Thread(target=self._hold, name="simyard server", daemon=True)

    def start(self) -> None:
        """Returns when there is a server.

        Raises:
            StageFailed: There is none, and none comes up.
        """
        self._thread.start()
        try:
            self._ready.wait()
        except BaseException:  # Ctrl-C, or the interrupt of a notebook
            self._unused.set()
            raise
        if self._failure:
            raise self._failure

    def end(self) -> None:
        """Returns when a server that was started has ended."""
        self._unused.set()
        self._thread.join()

    def _hold(self) -> None:
        from flows.server.prefect_server import prefect_server  # noqa: PLC0415 - only where a server is wanted

        try:
            with prefect_server():
                self.variables = {name: os.environ[name] for name in _VARIABLES if name in os.environ}
                self._ready.set()
                self._unused.wait()
        except BaseException as exc:  # noqa: BLE001 - raised where the server is asked for
            self._failure = exc
            self._ready.set()


holders: list[Holder] = []


@contextmanager
def shared_server() -> Generator[dict[str, str], None, None]:
    """Yields the variables by which Prefect reaches the server that `simyard run` would use.

    Raises:
        StageFailed: There is none, and none comes up.
    """
    with _one_counts:
        if not holders:
            holder = Holder()
            holder.start()
            holders.append(holder)
        holder = holders[-1]
        holder.users += 1
    try:
        yield dict(holder.variables)
    finally:
        with _one_counts:
            holder.users -= 1
            if not holder.users:
                holders.remove(holder)
                holder.end()
