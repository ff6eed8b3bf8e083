"""The gateway's own workers: a foreman in a process of its own, told of work over a pipe, begun again if it dies.

The queue is in the store, so that nothing is lost with a worker or with the gateway. The end of the pipe ends the
foreman and its lanes, however the gateway ends.
"""

import sys
from types import TracebackType

from flows.queue.kept_process import KeptProcess


class Crew:
    """Works off the queue of a store inside a ``with`` block.

    Args:
        store_url: Where the queue is.
        workers: How many jobs of a lane are worked on at once; 0 for none, because workers elsewhere do.
        pool: Prefect's work pool to which jobs are handed instead; empty for none.
    """

    def __init__(self, store_url: str, workers: int = 1, pool: str = "") -> None:
        arguments = [store_url, str(workers), *([pool] if pool else [])]
        self._command = [sys.executable, "-m", "flows.queue.foreman", *arguments] if workers or pool else []
        self._foreman: KeptProcess | None = None

    def __enter__(self) -> "Crew":
        """Starts the workers, which are warm some seconds later."""
        if self._command:
            self._foreman = KeptProcess(self._command, "the foreman of the workers")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends the workers; what they are at is continued next time."""
        if self._foreman:
            self._foreman.end()

    def wake(self) -> None:
        """Tells the workers that there is work."""
        if self._foreman:
            self._foreman.wake()
