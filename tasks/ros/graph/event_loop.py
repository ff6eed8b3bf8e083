"""Connections of an episode: non-blocking sockets on the loopback, served by callbacks of one event loop.

Whatever has come is read and dealt with in the loop's same turn, and counted. So whoever looks at the counters between
two turns knows whether a request is under way; no task waits half-way with bytes that it has taken.
"""

import asyncio
import logging
import socket
from collections.abc import Callable

from tasks.ros.graph import graph_limits as limits

HOST = "127.0.0.1"
_logger = logging.getLogger(__name__)
_CHUNK_BYTES = 256 * 1024
_ACCEPT_AGAIN_S = 0.1


class EventLoop:
    """All sockets of one episode, and how much goes on there.

    Attributes:
        busy: How many answers are awaited: calls, handshakes, bytes that a node has not taken yet.
        served: Grows with every part of a request and every connection.
        failure: Why this episode cannot go on; empty while it can.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, new_socket: Callable[[], socket.socket]) -> None:
        self.loop = loop
        self.busy = self.served = 0
        self._buffered = 0
        self.failure = ""
        self._new_socket = new_socket
        self._listeners: list[socket.socket] = []
        self._connections: set[Connection] = set()

    def fail(self, reason: str) -> None:
        """Notes why the episode cannot go on; the first reason counts."""
        self.failure = self.failure or reason

    def buffer(self, count: int) -> bool:
        """Notes that so many bytes more are kept, or fewer; returns whether that is within the limit."""
        within = self._buffered + count <= limits.BUFFERED_BYTES
        if within or count < 0:
            self._buffered += count
        else:
            self.fail(f"its connections would hold {self._buffered + count} bytes: {limits.BUFFERED_BYTES} are kept")
        return within

    def listen(self, accept: Callable[[socket.socket], None]) -> int:
        """Takes connections on a new port, which is returned.

        Args:
            accept: Called with each connection.
        """
        sock = self._new_socket()
        self._listeners.append(sock)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((HOST, 0))
        sock.listen(64)
        sock.settimeout(0.0)
        self.loop.add_reader(sock, self._accept, sock, accept)
        return int(sock.getsockname()[1])

    def connection(self, sock: socket.socket, on_data: Callable[[], None], on_end: Callable[[], None]) -> "Connection":
        """Returns a connection whose socket this episode closes in the end."""
        made = Connection(self, sock, on_data, on_end)
        self._connections.add(made)
        return made

    def connect(self, port: int, on_data: Callable[[], None], on_end: Callable[[], None]) -> "Connection":
        """Returns a connection to a node's port: what is sent waits until it stands; ``on_end`` says if it fails.

        Raises:
            OSError: If no socket is left.
        """
        sock = self._new_socket()
        sock.settimeout(0.0)
        sock.connect_ex((HOST, port))
        return self.connection(sock, on_data, on_end)

    def forget(self, connection: "Connection") -> None:
        """Drops a connection that is closed, or in other hands."""
        self._connections.discard(connection)

    def close(self) -> None:
        """Closes every socket; a second time does nothing."""
        for sock in self._listeners:
            if sock.fileno() >= 0:
                self.loop.remove_reader(sock)
                sock.close()
        for connection in list(self._connections):
            connection.drop()

    def _accept(self, listener: socket.socket, accept: Callable[[socket.socket], None]) -> None:
        try:
            sock, _ = listener.accept()
        except (BlockingIOError, ConnectionError, InterruptedError):
            return
        except OSError as exc:
            # No file descriptors are left: asking at once again would take a whole core.
            _logger.warning("No connection can be taken: %s.", exc)
            self.loop.remove_reader(listener)
            self.loop.call_later(_ACCEPT_AGAIN_S, self._resume, listener, accept)
            return
        self.served += 1
        if len(self._connections) >= limits.CONNECTIONS:
            self.fail(f"its nodes hold more than {limits.CONNECTIONS} connections to the simulation")
            sock.close()
            return
        sock.settimeout(0.0)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        accept(sock)

    def _resume(self, listener: socket.socket, accept: Callable[[socket.socket], None]) -> None:
        if listener.fileno() >= 0:
            self.loop.add_reader(listener, self._accept, listener, accept)


class Connection:
    """One connection with what has come and what is still to be sent.

    Attributes:
        incoming: What has come; whoever uses it cuts it off.
        held_bytes: How much of that whoever uses it has cut off and keeps, such as half a request: it counts as well.
        closed: Whether its socket is closed or in other hands.
    """

    def __init__(
        self, events: EventLoop, sock: socket.socket, on_data: Callable[[], None], on_end: Callable[[], None]
    ) -> None:
        self.incoming = bytearray()
        self.held_bytes = 0
        self.closed = False
        self._events, self._sock = events, sock
        self._on_data, self._on_end = on_data, on_end
        self._outgoing = bytearray()
        self._counted = 0
        self._ends = False
        self._deadline: asyncio.TimerHandle | None = None
        events.loop.add_reader(sock, self._read)

    def use(self, on_data: Callable[[], None], on_end: Callable[[], None]) -> None:
        """Gives the connection to somebody else, who hears of data and of its end from now on."""
        self._on_data, self._on_end = on_data, on_end

    @property
    def backlog_bytes(self) -> int:
        """Returns how much the other side has not taken yet."""
        return len(self._outgoing)

    def send(self, data: bytes) -> None:
        """Sends bytes; what the kernel does not take now is sent by the loop."""
        if self.closed:
            return
        sent = 0
        if not self._outgoing:
            try:
                sent = self._sock.send(data)
            except (BlockingIOError, InterruptedError):
                pass
            except OSError:
                # A connection that does not stand yet refuses as well: the loop finds out which it is.
                sent = 0
        if sent < len(data):
            if not self._outgoing:
                self._events.busy += 1
                self._events.loop.add_writer(self._sock, self._write)
            self._outgoing += memoryview(data)[sent:]
            self._count()

    def limit_time(self, seconds: float | None) -> None:
        """Closes the connection after so much wall time; None lets it stay."""
        if self._deadline is not None:
            self._deadline.cancel()
        self._deadline = None if seconds is None else self._events.loop.call_later(seconds, self.close)

    def limited(self) -> bool:
        """Returns whether a deadline runs."""
        return self._deadline is not None

    def detach(self) -> socket.socket:
        """Returns the socket, which is in the caller's hands from now on."""
        self._release()
        return self._sock

    def finish(self) -> None:
        """Closes the connection when all is sent, or nobody reads it."""
        if self._outgoing:
            self._ends = True
            self.limit_time(limits.REQUEST_S)
        else:
            self.close()

    def drop(self) -> None:
        """Closes the connection, and tells nobody."""
        if not self.closed:
            self._release()
            self._sock.close()

    def close(self) -> None:
        """Closes the connection and says so to whoever uses it."""
        if not self.closed:
            self.drop()
            self._on_end()

    def _release(self) -> None:
        self.closed = True
        self.limit_time(None)
        self._events.loop.remove_reader(self._sock)
        self._events.loop.remove_writer(self._sock)
        if self._outgoing:
            self._events.busy -= 1
            self._outgoing.clear()
        self._events.buffer(-self._counted)
        self._counted = 0
        self._events.forget(self)

    def _count(self) -> None:
        """Closes the connection if the episode's connections hold too much."""
        kept = len(self.incoming) + self.held_bytes + len(self._outgoing)
        if self.closed:
            return
        if self._events.buffer(kept - self._counted):
            self._counted = kept
        elif kept > self._counted:
            self.close()

    def _read(self) -> None:
        try:
            data = self._sock.recv(_CHUNK_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            data = b""
        self._events.served += 1
        if not data:
            self.close()
            return
        self.incoming += data
        self._on_data()
        self._count()

    def _write(self) -> None:
        try:
            sent = self._sock.send(self._outgoing)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self.close()
            return
        del self._outgoing[:sent]
        self._count()
        if not self._outgoing:
            self._events.busy -= 1
            self._events.loop.remove_writer(self._sock)
            if self._ends:
                self.close()
