"""A network that loses what a server answers: the server has done the work, the client does not know."""

import socket
from collections.abc import Generator
from contextlib import contextmanager, suppress
from threading import Event, Thread
from urllib.parse import urlsplit

_CHUNK_BYTES = 1 << 16


class FaultyProxy:
    """Forwards connections to a server; loses an answer when told to.

    Attributes:
        endpoint: Where clients connect, ``http://127.0.0.1:<port>``.
        lost: How many answers were lost.
    """

    def __init__(self, server: str) -> None:
        parts = urlsplit(server)
        self._server = (parts.hostname or "", parts.port or 80)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._lose_next = Event()
        self._open: list[socket.socket] = [self._listener]
        self.endpoint = f"http://127.0.0.1:{self._listener.getsockname()[1]}"
        self.lost = 0
        Thread(target=self._accept, daemon=True).start()

    def lose_the_next_answer(self) -> None:
        """Cuts the connection over which the server answers next, instead of passing the answer on."""
        self._lose_next.set()

    def close(self) -> None:
        """Cuts all connections."""
        for each in self._open:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                server = socket.create_connection(self._server)
                self._open += [client, server]
                Thread(target=self._pass_on, args=(client, server), daemon=True).start()
                Thread(target=self._answer, args=(server, client), daemon=True).start()

    def _pass_on(self, client: socket.socket, server: socket.socket) -> None:
        with suppress(OSError):
            while data := client.recv(_CHUNK_BYTES):
                server.sendall(data)
            server.shutdown(socket.SHUT_WR)

    def _answer(self, server: socket.socket, client: socket.socket) -> None:
        with suppress(OSError):
            while data := server.recv(_CHUNK_BYTES):
                if self._lose_next.is_set() and not data.startswith(b"HTTP/1.1 100"):
                    self._lose_next.clear()
                    self.lost += 1
                    client.shutdown(socket.SHUT_RDWR)
                    return
                client.sendall(data)


@contextmanager
def faulty_proxy(server: str) -> Generator[FaultyProxy]:
    """Makes a proxy in front of the server, and closes it at the end."""
    proxy = FaultyProxy(server)
    try:
        yield proxy
    finally:
        proxy.close()
