"""Calls between the nodes of an episode: XML-RPC over HTTP, with bounds on both (xmlrpc.com/spec.md)."""

import datetime
import re
import socket
import xmlrpc.client
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple, NoReturn, TypeAlias, cast
from xml.parsers import expat

from tasks.ros.graph import graph_limits as limits
from tasks.ros.graph.event_loop import HOST, Connection, EventLoop

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

    def __init__(self, events: EventLoop, sock: socket.socket, answer: Callable[[bytes, Reply], None]) -> None:
        self._answer = answer
        self._waiting = False
        self._held = False
        self._invited = False
        self._connection = events.connection(sock, self._take, lambda: None)

    def _take(self) -> None:
        try:
            self._check_backlog()
            while not self._waiting and not self._connection.closed and self._next():
                self._check_backlog()
        except HttpError as exc:
            reason = f"{exc.status} {_REASONS[exc.status]}"
            body = f"{exc}\n".encode()
            head = f"HTTP/1.1 {reason}\r\nContent-Type: text/plain\r\nContent-Length: {len(body)}\r\nConnection: close"
            self._connection.send(head.encode() + _END + body)
            self._connection.finish()

    def _check_backlog(self) -> None:
        unread = self._connection.backlog_bytes and not self._waiting
        if unread or len(self._connection.incoming) > limits.BODY_BYTES + limits.HEADER_BYTES:
            raise HttpError(413, "more requests at once than are taken: read the answer first")

    def _next(self) -> bool:
        """Answers the next request, if all of it is there."""
        incoming = self._connection.incoming
        head = parse_head(incoming)
        length = 0 if head is None else _body_length(head)
        if head is None or len(incoming) < head.size + length:
            if incoming and not self._connection.limited():
                self._connection.limit_time(limits.REQUEST_S)
            if head is not None and head.fields.get("expect", "").lower() == "100-continue" and not self._invited:
                self._invited = True
                self._connection.send(b"HTTP/1.1 100 Continue" + _END)
            return False
        self._connection.limit_time(None)
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
        self._connection.send(f"{fields}Connection: {'keep-alive' if kept else 'close'}".encode() + _END + data)
        self._waiting = False
        if not kept:
            self._connection.finish()
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


Value: TypeAlias = "bool | int | float | str | bytes | datetime.datetime | list[Value] | dict[str, Value] | None"
_OVERHEAD_BYTES = 64


class XmlRpcError(ValueError):
    """The bytes are not a call or an answer."""


def read(data: bytes) -> tuple[tuple[Value, ...], str | None]:
    """Returns the arguments and the method of a call; of an answer, its value alone and None.

    Raises:
        XmlRpcError: If it is no XML-RPC, or brings a document type.
        xmlrpc.client.Fault: If it is an answer that says so.
    """
    target = xmlrpc.client.Unmarshaller(use_builtin_types=True)
    # Texts come from expat as str: there is no encoding left to undo.
    target.xml(cast("str", None), None)
    parser = expat.ParserCreate(None, None)
    parser.StartElementHandler = target.start
    parser.EndElementHandler = target.end
    parser.CharacterDataHandler = target.data
    parser.StartDoctypeDeclHandler = _refuse_document_type
    try:
        parser.Parse(data, True)  # noqa: FBT003 - expat takes no keyword
        values = cast("tuple[Value, ...]", tuple(cast("Any", target.close())))
    except xmlrpc.client.Fault:
        raise
    except (expat.ExpatError, xmlrpc.client.Error, ValueError, TypeError, LookupError, AttributeError) as exc:
        raise XmlRpcError(f"no XML-RPC: {exc}") from exc
    _check_depth(values)
    return values, target.getmethodname()


def write_call(method: str, arguments: tuple[Value, ...]) -> bytes:
    """Returns a call."""
    return xmlrpc.client.dumps(cast("Any", arguments), method).encode()


def write_answer(value: Value) -> bytes:
    """Returns an answer; a fault if the value has no form in XML-RPC."""
    try:
        return xmlrpc.client.dumps(cast("Any", (value,)), methodresponse=True).encode()
    except (TypeError, OverflowError, UnicodeEncodeError, ValueError) as exc:
        return write_fault(f"the answer has no form in XML-RPC: {exc}")


def write_fault(reason: str) -> bytes:
    """Returns an answer that says what is wrong with the call."""
    return xmlrpc.client.dumps(xmlrpc.client.Fault(1, reason.encode("ascii", "replace").decode())).encode()


def weight(value: Value, depth: int = 0) -> int:
    """Returns about how many bytes a value takes.

    Raises:
        XmlRpcError: If it holds what no node can be given: nothing, numbers of more than 32 bits, too many levels.
    """
    if depth > limits.PARAMETER_DEPTH:
        raise XmlRpcError(f"a value of more than {limits.PARAMETER_DEPTH} levels")
    if isinstance(value, dict):
        return sum(weight(key) + weight(each, depth + 1) for key, each in value.items()) + _OVERHEAD_BYTES
    if isinstance(value, list):
        return sum(weight(each, depth + 1) for each in value) + _OVERHEAD_BYTES
    if isinstance(value, str | bytes):
        return len(value) + _OVERHEAD_BYTES
    if isinstance(value, int) and not -(2**31) <= value < 2**31:
        raise XmlRpcError(f"{value}: XML-RPC has whole numbers of 32 bits")
    if isinstance(value, int | float | datetime.datetime):
        return _OVERHEAD_BYTES
    raise XmlRpcError(f"{type(value).__name__}: a parameter is a bool, number, text, time, list or mapping")


def _check_depth(values: tuple[Value, ...]) -> None:
    """Refuses what a function that calls itself could not go through."""
    level: list[Value] = [each for each in values if isinstance(each, list | dict)]
    # Arguments of a multicall lie within three levels of its own.
    for _ in range(limits.PARAMETER_DEPTH + 4):
        below = [each.values() if isinstance(each, dict) else each for each in level if isinstance(each, list | dict)]
        level = [each for values in below for each in values if isinstance(each, list | dict)]
        if not level:
            return
    raise XmlRpcError(f"a value of more than {limits.PARAMETER_DEPTH} levels")


def _refuse_document_type(*_: object) -> NoReturn:
    raise XmlRpcError("a document type: calls have none")


_URI = re.compile(r"http://[^/:\s]+:([0-9]{1,5})/?")


class NodeAnswer(NamedTuple):
    """What a node answered.

    Attributes:
        value: None if there is none.
        fault: Why there is none; empty if there is one.
    """

    value: Value
    fault: str = ""


Heard = Callable[[NodeAnswer], None]


class _Waiting(NamedTuple):
    body: bytes
    heard: Heard


def node_port(uri: str) -> int:
    """Returns the port of a node's address; its host is this machine, whatever name it has there.

    Raises:
        ValueError: If the address is none.
    """
    found = _URI.fullmatch(uri)
    if found is None or not 0 < int(found[1]) < 65536:
        raise ValueError(f"{uri[:200]!r}: a node's address is http://HOST:PORT/")
    return int(found[1])


class NodeCalls:
    """Calls that wait or are under way, by the nodes' ports."""

    def __init__(self, events: EventLoop) -> None:
        self._events = events
        self._queues: dict[int, deque[_Waiting]] = {}

    def call(self, uri: str, method: str, arguments: tuple[Value, ...], heard: Heard = lambda _: None) -> None:
        """Calls a node.

        Args:
            uri: Its address.
            method: Of the slave API.
            arguments: The caller's name first.
            heard: Called with the answer, once, whatever becomes of the call.
        """
        try:
            port = node_port(uri)
            waiting = _Waiting(write_call(method, arguments), heard)
        except (ValueError, TypeError, OverflowError) as exc:
            heard(NodeAnswer(None, str(exc)))
            return
        queue = self._queues.get(port)
        if (len(self._queues) >= limits.NODES) if queue is None else (len(queue) >= limits.CALLS):
            heard(NodeAnswer(None, f"{uri} cannot be called: too many calls are under way"))
            return
        if not self._events.buffer(len(waiting.body)):
            heard(NodeAnswer(None, f"{uri} cannot be called: {self._events.failure}"))
            return
        queue = self._queues.setdefault(port, deque())
        queue.append(waiting)
        self._events.busy += 1
        if len(queue) == 1:
            self._begin(port)

    def _begin(self, port: int) -> None:
        try:
            _Call(self._events, port, self._queues[port][0].body, lambda answer: self._finish(port, answer))
        except OSError as exc:
            self._events.loop.call_soon(self._finish, port, NodeAnswer(None, f"port {port}: {exc}"))

    def _finish(self, port: int, answer: NodeAnswer) -> None:
        queue = self._queues[port]
        done = queue.popleft()
        self._events.buffer(-len(done.body))
        self._events.busy -= 1
        if queue:
            self._begin(port)
        else:
            del self._queues[port]
        done.heard(answer)


class _Call:
    """One request and its answer, on a connection of its own."""

    def __init__(self, events: EventLoop, port: int, body: bytes, heard: Heard) -> None:
        self._port, self._heard = port, heard
        self._connection: Connection = events.connect(port, self._take, self._end)
        self._connection.limit_time(limits.CALL_S)
        head = f"POST /RPC2 HTTP/1.1\r\nHost: {HOST}:{port}\r\nContent-Type: text/xml\r\nConnection: close\r\n"
        self._connection.send(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body)

    def _take(self) -> None:
        try:
            answer = self._read()
        except (HttpError, XmlRpcError) as exc:
            answer = NodeAnswer(None, f"port {self._port}: {exc}")
        except xmlrpc.client.Fault as exc:
            answer = NodeAnswer(None, f"port {self._port}: {exc.faultString}")
        if answer is not None:
            self._connection.drop()
            self._heard(answer)

    def _read(self) -> NodeAnswer | None:
        incoming = self._connection.incoming
        head = parse_head(incoming)
        if head is None:
            return None
        length = head.length()
        if length is None:
            raise HttpError(411, "an answer without Content-Length")
        if len(incoming) < head.size + length:
            return None
        values, _ = read(bytes(incoming[head.size : head.size + length]))
        match values:
            case ([1, _, value],):
                return NodeAnswer(value)
            case ([_, message, *_],):
                return NodeAnswer(None, f"port {self._port}: {message}")
            case _:
                raise XmlRpcError("an answer that is not [code, message, value]")

    def _end(self) -> None:
        self._heard(NodeAnswer(None, f"port {self._port}: no answer"))
