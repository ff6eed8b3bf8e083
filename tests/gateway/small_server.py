"""uvicorn with the bounded protocol and a small application, in a thread of the test."""

import asyncio
import socket
import ssl
import threading
from collections.abc import Generator
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple, cast

import uvicorn

from tasks.gateway.connections import BoundedProtocol, Bounds, Connections

BIG_BYTES = 8 << 20
REQUEST = b"GET / HTTP/1.1\r\nhost: a\r\n\r\n"


class SmallServer(NamedTuple):
    """Attributes: where it is, and its connections."""

    port: int
    connections: Connections

    def connect(self) -> socket.socket:
        """Returns a connection, which waits 10 s at most."""
        return socket.create_connection(("127.0.0.1", self.port), 10)


@contextmanager
def small_server(bounds: Bounds, tls: ssl.SSLContext | None = None) -> Generator[SmallServer]:
    """Yields a server that answers /big with many bytes, and all else with how long the body was."""
    connections = Connections(bounds)
    protocol = partial(BoundedProtocol, all_connections=connections, tls=tls)
    config = uvicorn.Config(
        _answer,
        http=cast("Any", protocol),
        ws="none",
        loop="asyncio",
        log_config=None,
        log_level="critical",
        lifespan="off",
        timeout_keep_alive=cast("Any", bounds.idle_s),
        timeout_graceful_shutdown=1,
    )
    server = uvicorn.Server(config)
    listener = socket.socket()
    listener.bind(("127.0.0.1", 0))
    thread = threading.Thread(target=lambda: asyncio.run(server.serve([listener])), daemon=True)
    thread.start()
    while not server.started:
        thread.join(0.01)
    try:
        yield SmallServer(listener.getsockname()[1], connections)
    finally:
        server.should_exit = True
        thread.join()
        listener.close()


def all_of(connection: socket.socket) -> bytes:
    """Returns what a connection says until its end."""
    found = b""
    try:
        while part := connection.recv(1 << 16):
            found += part
    except ConnectionResetError:
        pass
    return found


async def _answer(scope: Any, receive: Any, send: Any) -> None:  # noqa: ANN401 - ASGI
    chunked = any(name == b"transfer-encoding" for name, _ in scope["headers"])
    length, more = 0, not chunked
    while more:
        message = await receive()
        length += len(message.get("body", b""))
        more = message.get("more_body", False)
    body = bytes(BIG_BYTES) if scope["path"] == "/big" else str(length).encode()
    close = [(b"connection", b"close")] if chunked else []
    headers = [(b"content-length", str(len(body)).encode()), *close]
    await send({"type": "http.response.start", "status": 411 if chunked else 200, "headers": headers})
    await send({"type": "http.response.body", "body": body})
