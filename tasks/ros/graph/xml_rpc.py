"""Calls between the nodes of an episode: XML-RPC over HTTP, with bounds on both (xmlrpc.com/spec.md)."""

import datetime
import re
import socket
import xmlrpc.client
from collections import deque
from collections.abc import Callable
from http import HTTPStatus
from typing import Any, NamedTuple, NoReturn, TypeAlias, cast
from xml.parsers import expat

import h11

from tasks.ros.graph import graph_limits as limits
from tasks.ros.graph.event_loop import HOST, Connection, EventLoop

Reply = Callable[[bytes], None]


class HttpError(ValueError):
    """What was sent is not HTTP, or more than is taken.

    Attributes:
        status: What HTTP calls it.
    """

    def __init__(self, status: int, reason: str) -> None:
        self.status = status
        super().__init__(reason)


class HttpMessage:
    """One request or answer of a connection, read as it comes; its head and its body are bounded.

    Args:
        role: ``h11.SERVER`` reads a request, ``h11.CLIENT`` an answer.
        connection: What it comes on. A message after it stays there.

    Attributes:
        http: The rules of HTTP for this message and the one that answers it.
    """

    def __init__(self, role: type[h11.CLIENT] | type[h11.SERVER], connection: Connection) -> None:
        self.http = h11.Connection(role, max_incomplete_event_size=limits.HEADER_BYTES)
        self._connection = connection
        self._body = bytearray()

    def read(self) -> bytes | None:
        """Takes what has come off the connection; returns the body once all of it is there.

        Raises:
            HttpError: If it is no HTTP, does not say how long its body is, or is too long.
        """
        incoming = self._connection.incoming
        if incoming:
            self.http.receive_data(bytes(incoming))
            incoming.clear()
        while isinstance(event := self._next_event(), h11.Event):
            if isinstance(event, h11.Request | h11.Response):
                _check_head(event)
            elif isinstance(event, h11.Data):
                self._body += event.data
            elif isinstance(event, h11.EndOfMessage):
                incoming += self.http.trailing_data[0]
                self._connection.held_bytes = 0
                return bytes(self._body)
        self._connection.held_bytes = len(self._body)
        return None

    def _next_event(self) -> h11.Event | type[h11.NEED_DATA] | type[h11.PAUSED]:
        try:
            return self.http.next_event()
        except h11.RemoteProtocolError as exc:
            raise HttpError(exc.error_status_hint, str(exc)) from exc


def _check_head(head: h11.Request | h11.Response) -> None:
    if isinstance(head, h11.Request) and head.method != b"POST":
        raise HttpError(405, "calls are sent with POST")
    fields = dict(head.headers)
    if b"transfer-encoding" in fields:
        raise HttpError(501, "a body in parts: send Content-Length")
    length = fields.get(b"content-length")
    if length is None:
        raise HttpError(411, "a call or answer without Content-Length")
    if int(length) > limits.BODY_BYTES:
        raise HttpError(413, f"a body of {int(length)} bytes: {limits.BODY_BYTES} are taken")


class HttpConnection:
    """One connection of a node to the graph's XML-RPC server; its requests are answered one after the other."""

    def __init__(self, events: EventLoop, sock: socket.socket, answer: Callable[[bytes, Reply], None]) -> None:
        self._answer = answer
        self._waiting = False
        self._held = False
        self._connection = events.connection(sock, self._take, lambda: None)
        self._message = HttpMessage(h11.SERVER, self._connection)

    def _take(self) -> None:
        try:
            self._check_backlog()
            while not self._waiting and not self._connection.closed and self._next():
                self._check_backlog()
        except HttpError as exc:
            self._waiting = False
            # An answer to HEAD has no body.
            body = b"" if exc.status == HTTPStatus.METHOD_NOT_ALLOWED else f"{exc}\n".encode()
            self._send(exc.status, "text/plain", body, close=True)

    def _check_backlog(self) -> None:
        unread = self._connection.backlog_bytes and not self._waiting
        if unread or len(self._connection.incoming) > limits.BODY_BYTES + limits.HEADER_BYTES:
            raise HttpError(413, "more requests at once than are taken: read the answer first")

    def _next(self) -> bool:
        """Answers the next request, if all of it is there."""
        if not self._connection.incoming:
            return False
        body = self._message.read()
        http = self._message.http
        if body is None:
            if not self._connection.limited():
                self._connection.limit_time(limits.REQUEST_S)
            if http.they_are_waiting_for_100_continue:
                self._connection.send(http.send(h11.InformationalResponse(status_code=100, headers=[])) or b"")
            return False
        self._connection.limit_time(None)
        self._waiting = True
        self._answer(body, self._reply)
        self._held = self._waiting
        return True

    def _reply(self, data: bytes) -> None:
        if not self._waiting:
            return
        self._waiting = False
        self._send(200, "text/xml", data)
        if self._held and not self._connection.closed:
            # What came while the answer was held.
            self._held = False
            self._take()

    def _send(self, status: int, kind: str, body: bytes, *, close: bool = False) -> None:
        """Answers the message; the connection ends where HTTP or ``close`` says so, else the next message follows."""
        http = self._message.http
        fields = [("Content-Type", kind), ("Content-Length", str(len(body))), *([("Connection", "close")] * close)]
        head = h11.Response(status_code=status, reason=HTTPStatus(status).phrase, headers=fields)
        parts = (http.send(event) for event in (head, h11.Data(data=body), h11.EndOfMessage()))
        self._connection.send(b"".join(filter(None, parts)))
        if http.our_state is h11.MUST_CLOSE or close:
            self._connection.finish()
        self._message = HttpMessage(h11.SERVER, self._connection)


Value: TypeAlias = "bool | int | float | str | bytes | datetime.datetime | list[Value] | dict[str, Value] | None"
_OVERHEAD_BYTES = 64


class XmlRpcError(ValueError):
    """The bytes are not a call or an answer."""


def read_xml(data: bytes) -> tuple[tuple[Value, ...], str | None]:
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
        self._message = HttpMessage(h11.CLIENT, self._connection)
        fields = {"Host": f"{HOST}:{port}", "Content-Type": "text/xml", "Connection": "close"}
        fields["Content-Length"] = str(len(body))
        head = h11.Request(method="POST", target="/RPC2", headers=[*fields.items()])
        parts = (self._message.http.send(event) for event in (head, h11.Data(data=body), h11.EndOfMessage()))
        self._connection.send(b"".join(filter(None, parts)))

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
        body = self._message.read()
        if body is None:
            return None
        match read_xml(body)[0]:
            case ([1, _, value],):
                return NodeAnswer(value)
            case ([_, message, *_],):
                return NodeAnswer(None, f"port {self._port}: {message}")
            case _:
                raise XmlRpcError("an answer that is not [code, message, value]")

    def _end(self) -> None:
        self._heard(NodeAnswer(None, f"port {self._port}: no answer"))
