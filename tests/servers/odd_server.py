"""A server that answers in the place of an S3 server, and not as one: a captive portal, a broken proxy, a stranger."""

import gzip
import socket
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from threading import Event, Thread

Answer = Callable[[socket.socket], None]
_HTML = b"<html><head><title>Welcome to Hotel WiFi</title></head><body>Please accept our terms.</body></html>"
_DRIP_S, _DRIPS = 0.05, 20
_MOST_HEAD_BYTES = 1 << 16


def _http(status: str, body: bytes = b"", *head: str, length: int | None = None) -> Answer:
    lines = [f"HTTP/1.1 {status}", f"Content-Length: {len(body) if length is None else length}", *head, "", ""]
    return lambda connection: connection.sendall("\r\n".join(lines).encode() + body)


def _endless_drip(begin: bytes) -> Answer:
    """Sends a beginning, and then a byte now and then for as long as somebody reads."""

    def answer(connection: socket.socket) -> None:
        connection.sendall(begin)
        while True:
            connection.sendall(b"a")
            Event().wait(_DRIP_S)

    return answer


def _slow_drip(connection: socket.socket) -> None:
    connection.sendall(b'HTTP/1.1 200 OK\r\nETag: "0"\r\nContent-Length: 1000\r\n\r\n')
    for _ in range(_DRIPS):
        connection.sendall(b"{")
        Event().wait(_DRIP_S)


def _reset(connection: socket.socket) -> None:
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")


def _tls(connection: socket.socket) -> None:
    connection.sendall(b"\x15\x03\x03\x00\x02\x02\x28")  # an alert: handshake failure


_ENDLESS_OBJECT = (
    b'HTTP/1.1 200 OK\r\nETag: "0"\r\nLast-Modified: Thu, 01 Jan 2026 00:00:00 GMT\r\nContent-Length: 1000000\r\n\r\n'
)
_XML = "Content-Type: application/xml"
_LIST = b'<?xml version="1.0"?><ListAllMyBucketsResult><Owner/></ListAllMyBucketsResult>'
_SOON = "Location: http://127.0.0.1:9/login"
ODD: Mapping[str, Answer] = {
    "200, a page": _http("200 OK", _HTML, "Content-Type: text/html"),
    "200, a page with an etag": _http("200 OK", _HTML, "Content-Type: text/html", 'ETag: "0"'),
    "200, empty": _http("200 OK"),
    "200, cut": _http("200 OK", _HTML, 'ETag: "0"', length=100_000),
    "200, a length that is none": lambda connection: connection.sendall(
        b'HTTP/1.1 200 OK\r\nETag: "0"\r\nContent-Length: many\r\n\r\n' + _HTML
    ),
    "200, a negative length": _http("200 OK", _HTML, 'ETag: "0"', length=-5),
    "200, no gzip": _http("200 OK", b"\x1f\x8bjunk", "Content-Encoding: gzip", 'ETag: "0"'),
    "200, gzip cut": _http("200 OK", gzip.compress(_HTML)[:-9], "Content-Encoding: gzip", 'ETag: "0"'),
    "200, chunks that are none": _http("200 OK", b"zz\r\n{}\r\n", "Transfer-Encoding: chunked", 'ETag: "0"'),
    "200, an answer to something else": _http("200 OK", _LIST, _XML),
    "200, XML cut": _http("200 OK", _LIST[:60], _XML, 'ETag: "0"'),
    "200, dates that are none": _http("200 OK", b"", "Last-Modified: soon", 'ETag: "0"', "Date: soon"),
    "200, drop by drop": _slow_drip,
    "200, drop by drop for ever": _endless_drip(_ENDLESS_OBJECT),
    "a head for ever": _endless_drip(b"HTTP/1.1 200 OK\r\nX: "),
    "an error's page for ever": _endless_drip(b"HTTP/1.1 500 No\r\nContent-Length: 1000000\r\n\r\n"),
    "204": _http("204 No Content"),
    "206": _http("206 Partial Content", _HTML, "Content-Range: bytes 9-1/0"),
    "301": _http("301 Moved Permanently", _HTML, _SOON),
    "302": _http("302 Found", _HTML, _SOON),
    "303 to nowhere": _http("303 See Other", b"", "Location: //"),
    "304": _http("304 Not Modified"),
    "307": _http("307 Temporary Redirect", _HTML, _SOON),
    "307 with a region": _http("307 Temporary Redirect", b"", "x-amz-bucket-region: \u00e9"),
    "400, a page": _http("400 Bad Request", _HTML),
    "401": _http("401 Unauthorized", _HTML, 'WWW-Authenticate: Basic realm="WiFi"'),
    "403, a page": _http("403 Forbidden", _HTML),
    "404, a page": _http("404 Not Found", _HTML),
    "407": _http("407 Proxy Authentication Required", _HTML),
    "409, a page": _http("409 Conflict", _HTML),
    "412": _http("412 Precondition Failed"),
    "416": _http("416 Range Not Satisfiable"),
    "429": _http("429 Too Many Requests", _HTML),
    "500, a page": _http("500 Internal Server Error", _HTML),
    "503, junk": _http("503 Service Unavailable", bytes(range(256)), _XML),
    "511": _http("511 Network Authentication Required", _HTML),
    "999": _http("999 Odd", _HTML),
    "100, cut": lambda connection: connection.sendall(b"HTTP/1.1 100 Continue\r\n"),
    "100 for ever": lambda connection: connection.sendall(b"HTTP/1.1 100 Continue\r\n\r\n" * 300),
    "no HTTP": lambda connection: connection.sendall(b"SSH-2.0-OpenSSH_9.2\r\n"),
    "a head without end": lambda connection: connection.sendall(b"HTTP/1.1 200 OK\r\nX: " + b"a" * 200_000),
    "many heads": lambda connection: connection.sendall(b"HTTP/1.1 200 OK\r\n" + b"X: a\r\n" * 500 + b"\r\n"),
    "a fault of TLS": _tls,
    "nothing": lambda _: None,
    "a reset": _reset,
}
"""What such a server may answer to anything, by its name."""
ENDLESS = frozenset({"200, drop by drop for ever", "a head for ever", "an error's page for ever"})
"""Those that go on for as long as somebody listens."""


class OddServer:
    """Answers each request on 127.0.0.1 in the way that is chosen.

    Attributes:
        answer: The name of the answer, of ``ODD``.
        answered: How often it was given, by its name.
        endpoint: Where clients connect.
    """

    def __init__(self, answer: str) -> None:
        self.answer = answer
        self.answered = dict.fromkeys(ODD, 0)
        self._ended = Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"http://127.0.0.1:{self._listener.getsockname()[1]}"
        Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        self._ended.set()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while not self._ended.is_set():
                connection, _ = self._listener.accept()
                Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection: socket.socket) -> None:
        with suppress(OSError), connection:
            connection.settimeout(10)
            head = b""
            while b"\r\n\r\n" not in head and len(head) < _MOST_HEAD_BYTES:
                if not (part := connection.recv(1 << 16)):
                    return
                head += part
            answer = self.answer
            self.answered[answer] += 1
            ODD[answer](connection)
            with suppress(OSError):
                if ODD[answer] is not _reset:
                    connection.shutdown(socket.SHUT_WR)
                    while connection.recv(1 << 16):
                        pass


@contextmanager
def odd_server(answer: str = "200, a page") -> Generator[OddServer]:
    """Runs one inside the block."""
    server = OddServer(answer)
    try:
        yield server
    finally:
        server.close()
