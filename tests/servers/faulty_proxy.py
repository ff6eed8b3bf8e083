"""A network that fails: it loses what a server answers, or breaks in the middle of what a client sends."""

import socket
from collections.abc import Generator
from contextlib import contextmanager, suppress
from threading import Event, Thread
from urllib.parse import urlsplit

_CHUNK_BYTES = 1 << 16


class FaultyProxy:
    """Forwards connections to a server; loses an answer, or cuts all off, when told to.

    Attributes:
        endpoint: Where clients connect, ``http://127.0.0.1:<port>``.
        lost: How many answers were lost.
        is_cut: Whether all connections were cut in the middle of a request.
    """

    def __init__(self, server: str) -> None:
        parts = urlsplit(server)
        self._server = (parts.hostname or "", parts.port or 80)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._lose_next = Event()
        self._drop_next_body = Event()
        self._refuses = Event()
        self._open: list[socket.socket] = [self._listener]
        self.endpoint = f"http://127.0.0.1:{self._listener.getsockname()[1]}"
        self.lost = 0
        self.is_cut = False
        self._left_bytes: int | None = None  # that may still be sent
        self._answers_left_bytes: int | None = None
        Thread(target=self._accept, daemon=True).start()

    def lose_the_next_answer(self) -> None:
        """Cuts the connection over which the server answers next, instead of passing the answer on."""
        self._lose_next.set()

    def drop_the_next_body(self) -> None:
        """Cuts the connection over which something is written next behind its headers, as a kill may do."""
        self._drop_next_body.set()

    def cut_after(self, sent_bytes: int) -> None:
        """Cuts all connections, for good, when clients have sent so many bytes more; those still arrive."""
        self._left_bytes = sent_bytes

    def cut_answers_after(self, answered_bytes: int) -> None:
        """Cuts every connection, for good, when servers have answered so many bytes more; those still arrive."""
        self._answers_left_bytes = answered_bytes

    def refuse(self) -> None:
        """Cuts all connections, and every new one, until they are accepted again."""
        self._refuses.set()
        for each in [*self._open[1:]]:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

    def accept(self) -> None:
        """Accepts connections again."""
        self._refuses.clear()

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
                if self._refuses.is_set():
                    client.close()
                    continue
                server = socket.create_connection(self._server)
                self._open += [client, server]
                Thread(target=self._pass_on, args=(client, server), daemon=True).start()
                Thread(target=self._answer, args=(server, client), daemon=True).start()

    def _pass_on(self, client: socket.socket, server: socket.socket) -> None:
        with suppress(OSError):
            while data := client.recv(_CHUNK_BYTES):
                if self._drop_next_body.is_set() and data.startswith(b"PUT "):
                    self._drop_next_body.clear()
                    self.lost += 1
                    server.sendall(data[: data.index(b"\r\n\r\n") + 4])
                    server.shutdown(socket.SHUT_WR)
                    return
                if self._left_bytes is not None and len(data) >= self._left_bytes:
                    server.sendall(data[: self._left_bytes])
                    self.is_cut = True
                    self.close()
                    return
                server.sendall(data)
                if self._left_bytes is not None:
                    self._left_bytes -= len(data)
            server.shutdown(socket.SHUT_WR)

    def _answer(self, server: socket.socket, client: socket.socket) -> None:
        with suppress(OSError):
            while data := server.recv(_CHUNK_BYTES):
                if self._lose_next.is_set() and not data.startswith(b"HTTP/1.1 100"):
                    self._lose_next.clear()
                    self.lost += 1
                    client.shutdown(socket.SHUT_RDWR)
                    return
                if self._answers_left_bytes is not None:
                    data = data[: self._answers_left_bytes]
                    self._answers_left_bytes -= len(data)
                client.sendall(data)
                if self._answers_left_bytes == 0:
                    self.is_cut = True
                    self.close()


@contextmanager
def faulty_proxy(server: str) -> Generator[FaultyProxy]:
    """Makes a proxy in front of the server, and closes it at the end."""
    proxy = FaultyProxy(server)
    try:
        yield proxy
    finally:
        proxy.close()
