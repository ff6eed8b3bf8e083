"""Calls of nodes' own XML-RPC: one at a time to each node, so that it hears of changes in their order."""

import re
import xmlrpc.client
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from tasks.ros.graph.wire import graph_limits as limits
from tasks.ros.graph.wire.channel import HOST, Channel, Wire
from tasks.ros.graph.wire.http import HttpError, parse_head
from tasks.ros.graph.wire.xml_rpc import Value, XmlRpcError, read, write_call

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

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
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
        if not self._wire.buffer(len(waiting.body)):
            heard(NodeAnswer(None, f"{uri} cannot be called: {self._wire.failure}"))
            return
        queue = self._queues.setdefault(port, deque())
        queue.append(waiting)
        self._wire.busy += 1
        if len(queue) == 1:
            self._begin(port)

    def _begin(self, port: int) -> None:
        try:
            _Call(self._wire, port, self._queues[port][0].body, lambda answer: self._finish(port, answer))
        except OSError as exc:
            self._wire.loop.call_soon(self._finish, port, NodeAnswer(None, f"port {port}: {exc}"))

    def _finish(self, port: int, answer: NodeAnswer) -> None:
        queue = self._queues[port]
        done = queue.popleft()
        self._wire.buffer(-len(done.body))
        self._wire.busy -= 1
        if queue:
            self._begin(port)
        else:
            del self._queues[port]
        done.heard(answer)


class _Call:
    """One request and its answer, on a connection of its own."""

    def __init__(self, wire: Wire, port: int, body: bytes, heard: Heard) -> None:
        self._port, self._heard = port, heard
        self._channel: Channel = wire.connect(port, self._take, self._end)
        self._channel.limit_time(limits.CALL_S)
        head = f"POST /RPC2 HTTP/1.1\r\nHost: {HOST}:{port}\r\nContent-Type: text/xml\r\nConnection: close\r\n"
        self._channel.send(f"{head}Content-Length: {len(body)}\r\n\r\n".encode() + body)

    def _take(self) -> None:
        try:
            answer = self._read()
        except (HttpError, XmlRpcError) as exc:
            answer = NodeAnswer(None, f"port {self._port}: {exc}")
        except xmlrpc.client.Fault as exc:
            answer = NodeAnswer(None, f"port {self._port}: {exc.faultString}")
        if answer is not None:
            self._channel.drop()
            self._heard(answer)

    def _read(self) -> NodeAnswer | None:
        incoming = self._channel.incoming
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
