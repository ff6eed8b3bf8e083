"""Turns of the event loop that serves all graphs, and naps that end when something comes."""

import asyncio
import contextlib
import select
import selectors
import socket

_TURNS = 1000


class EventPump:
    """An event loop that runs only when it is asked to, so that nothing happens behind the back of whoever asks.

    Attributes:
        loop: Serves the graphs.
    """

    def __init__(self) -> None:
        # Both descriptors are made before any lane has its own: select() takes none above 1023, and it alone naps for
        # less than a millisecond.
        selector = selectors.EpollSelector()
        self.loop = asyncio.SelectorEventLoop(selector)
        self._requests = selector.fileno()
        self._commands = select.epoll()

    def watch(self, sock: socket.socket) -> None:
        """Lets naps end when a command comes."""
        with contextlib.suppress(FileExistsError):
            self._commands.register(sock, select.EPOLLIN)

    def serve(self) -> None:
        """Answers all requests that have come, and those that come meanwhile."""
        for _ in range(_TURNS):
            if not select.select([self._requests], [], [], 0.0)[0]:
                return
            self.turn()

    def turn(self) -> None:
        """Runs the loop once: what has come, and what is due."""
        self.loop.call_soon(self.loop.stop)
        self.loop.run_forever()

    def nap(self, seconds: float) -> bool:
        """Waits until a request or a command comes, or the time is over; returns whether a command came."""
        return self._commands in select.select([self._requests, self._commands], [], [], max(seconds, 0.0))[0]

    def close(self) -> None:
        """Closes the loop."""
        self._commands.close()
        self.loop.close()
