"""HTTP as XML-RPC uses it: heads of requests and answers, and the server's side of a connection that is kept."""

import socket
from collections.abc import Callable
from typing import NamedTuple

from tasks.ros.graph.wire import graph_limits as limits
from tasks.ros.graph.wire.channel import Wire

Reply = Callable[[bytes], None]
_END = b"\r\n\r\n"
_REASONS = {
    400: "Bad Request",
    405: "Method Not Allowed",
    411: "Length Required",
    413: "Content Too Large",
    431: "Request Header Fields Too Large",
    501: "Not Implemented",
}


class HttpError(ValueError):
    """What was sent is not HTTP, or more than is taken.

    Attributes:
        status: What HTTP calls it.
    """

    def __init__(self, status: int, reason: str) -> None:
        self.status = status
        super().__init__(reason)


class Head(NamedTuple):
    """First line and fields of a request or answer.

    Attributes:
        line: The first line.
        fields: By their names in small letters.
        size: Bytes of the head with its end.
    """

    line: str
    fields: dict[str, str]
    size: int

    def length(self) -> int | None:
        """Returns how long the body is; None if it does not say.

        Raises:
            HttpError: If the length is no number, or above the limit.
        """
        if "transfer-encoding" in self.fields:
            raise HttpError(501, "a body in parts: send Content-Length")
        value = self.fields.get("content-length")
        if value is None:
            return None
        if not (value.isascii() and value.isdigit()):
            raise HttpError(400, f"Content-Length {value!r}")
        if len(value) > 10 or int(value) > limits.BODY_BYTES:
            raise HttpError(413, f"a body of {value[:20]} bytes: {limits.BODY_BYTES} are taken")
        return int(value)


def parse_head(data: bytearray) -> Head | None:
    """Returns the head that the bytes begin with; None while it is not complete.

    Raises:
        HttpError: If it is too long, or not one.
    """
    end = data.find(_END, 0, limits.HEADER_BYTES)
    if end < 0:
        if len(data) > limits.HEADER_BYTES:
            raise HttpError(431, f"a head of more than {limits.HEADER_BYTES} bytes")
        return None
    line, *rest = data[:end].decode("latin-1").split("\r\n")
    fields: dict[str, str] = {}
    for each in rest:
        name, colon, value = each.partition(":")
        key = name.strip().lower()
        if not colon or (key == "content-length" and fields.get(key, value.strip()) != value.strip()):
            raise HttpError(400, f"a field of the head: {each[:80]!r}")
        fields[key] = value.strip()
    return Head(line, fields, end + len(_END))


class HttpConnection:
    """One connection of a node to the graph's XML-RPC server; its requests are answered one after the other."""

    def __init__(self, wire: Wire, sock: socket.socket, answer: Callable[[bytes, Reply], None]) -> None:
        self._answer = answer
        self._waiting = False
        self._held = False
        self._invited = False
        self._channel = wire.channel(sock, self._take, lambda: None)

    def _take(self) -> None:
        try:
            self._check_backlog()
            while not self._waiting and not self._channel.closed and self._next():
                self._check_backlog()
        except HttpError as exc:
            reason = f"{exc.status} {_REASONS[exc.status]}"
            body = f"{exc}\n".encode()
            head = f"HTTP/1.1 {reason}\r\nContent-Type: text/plain\r\nContent-Length: {len(body)}\r\nConnection: close"
            self._channel.send(head.encode() + _END + body)
            self._channel.finish()

    def _check_backlog(self) -> None:
        unread = self._channel.backlog_bytes and not self._waiting
        if unread or len(self._channel.incoming) > limits.BODY_BYTES + limits.HEADER_BYTES:
            raise HttpError(413, "more requests at once than are taken: read the answer first")

    def _next(self) -> bool:
        """Answers the next request, if all of it is there."""
        incoming = self._channel.incoming
        head = parse_head(incoming)
        length = 0 if head is None else _body_length(head)
        if head is None or len(incoming) < head.size + length:
            if incoming and not self._channel.limited():
                self._channel.limit_time(limits.REQUEST_S)
            if head is not None and head.fields.get("expect", "").lower() == "100-continue" and not self._invited:
                self._invited = True
                self._channel.send(b"HTTP/1.1 100 Continue" + _END)
            return False
        self._channel.limit_time(None)
        self._invited = False
        body = bytes(incoming[head.size : head.size + length])
        del incoming[: head.size + length]
        self._waiting = True
        self._answer(body, lambda data: self._reply(head, data))
        self._held = self._waiting
        return True

    def _reply(self, head: Head, data: bytes) -> None:
        kept = not head.line.endswith("HTTP/1.0") and head.fields.get("connection", "").lower() != "close"
        fields = f"HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: {len(data)}\r\n"
        self._channel.send(f"{fields}Connection: {'keep-alive' if kept else 'close'}".encode() + _END + data)
        self._waiting = False
        if not kept:
            self._channel.finish()
        elif self._held:
            # What came while the answer was held.
            self._held = False
            self._take()


def _body_length(head: Head) -> int:
    if not head.line.startswith("POST "):
        raise HttpError(405, "calls are sent with POST")
    length = head.length()
    if length is None:
        raise HttpError(411, "a call without Content-Length")
    return length
