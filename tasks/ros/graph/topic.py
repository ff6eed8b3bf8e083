"""The robot's topics over TCPROS: headers of connections, publications, subscriptions (wiki.ros.org/ROS/TCPROS)."""

import asyncio
import socket
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from tasks.ros.graph import graph_limits as limits
from tasks.ros.graph.event_loop import Connection, EventLoop
from tasks.ros.graph.master import Registrations
from tasks.ros.graph.xml_rpc import NodeAnswer, NodeCalls, Value
from tasks.ros.message.definition import ANY, definition, type_digest
from tasks.ros.message.ros_messages import frame_message

_LENGTH = struct.Struct("<I")


class HeaderError(ValueError):
    """The bytes are no connection header."""


def write_header(fields: Mapping[str, str]) -> bytes:
    """Returns a header with its length before it."""
    parts = [f"{key}={value}".encode() for key, value in fields.items()]
    body = b"".join(_LENGTH.pack(len(part)) + part for part in parts)
    return _LENGTH.pack(len(body)) + body


def take_header(data: bytearray) -> dict[str, str] | None:
    """Returns the header that the bytes begin with, and cuts it off; None while it is not complete.

    Raises:
        HeaderError: If it is longer than a header may be, or no header.
    """
    if len(data) < 4:
        return None
    (length,) = _LENGTH.unpack_from(data)
    if length > limits.HEADER_BYTES:
        raise HeaderError(f"a header of {length} bytes: {limits.HEADER_BYTES} are taken")
    if len(data) < 4 + length:
        return None
    fields = _read_fields(bytes(data[4 : 4 + length]))
    del data[: 4 + length]
    return fields


def _read_fields(data: bytes) -> dict[str, str]:
    fields: dict[str, str] = {}
    at = 0
    while at < len(data):
        if at + 4 > len(data):
            raise HeaderError("a header that ends within a length")
        (length,) = _LENGTH.unpack_from(data, at)
        part = data[at + 4 : at + 4 + length]
        key, equals, value = part.partition(b"=")
        if len(part) != length or not equals:
            raise HeaderError("a header with a field that is not key=value")
        fields[key.decode("utf-8", "replace")] = value.decode("utf-8", "replace")
        at += 4 + length
    return fields


ROBOT = "/simyard"


class Topic(NamedTuple):
    """A topic of the robot.

    Attributes:
        name: Absolute.
        kind: Its message's type.
        latched: Whether whoever subscribes gets the last message at once.
    """

    name: str
    kind: str
    latched: bool = False


class Subscriber(NamedTuple):
    """A connection to a node that listens to a topic of the robot."""

    node: str
    connection: Connection


class Publications:
    """All topics that the robot publishes.

    Attributes:
        outgoing: Who is connected, by topic.
        latched: The last message of latched topics, with its length before it.
        changes: Grows with every connection that begins.
    """

    def __init__(self, events: EventLoop, topics: Sequence[Topic]) -> None:
        self._events = events
        self.topics: Mapping[str, Topic] = {topic.name: topic for topic in topics}
        self.outgoing: dict[str, list[Subscriber]] = {topic.name: [] for topic in topics}
        self.latched: dict[str, bytes] = {}
        self.changes = 0

    def publish(self, topic: str, data: bytes) -> bool:
        """Sends a message to all who listen; returns whether anybody does.

        Args:
            topic: One of the robot's.
            data: The message without its length.
        """
        frame = frame_message(data)
        if self.topics[topic].latched:
            self.latched[topic] = frame
        subscribers = self.outgoing[topic]
        for each in tuple(subscribers):
            self._send(topic, each, frame)
        return bool(subscribers)

    def keep(self, topic: str, data: bytes) -> None:
        """Keeps a message for those who subscribe to a latched topic from now on."""
        self.latched[topic] = frame_message(data)

    def connect(self, connection: Connection, fields: Mapping[str, str]) -> None:
        """Answers a subscriber's header, and lets it have what is published from now on."""
        node, topic = fields.get("callerid", "a node without callerid")[:200], fields.get("topic", "")
        fault = self._fault(node, topic, fields)
        if fault:
            connection.send(write_header({"error": fault}))
            connection.finish()
            return
        kind = self.topics[topic].kind
        answer = {
            "callerid": ROBOT,
            "latching": str(int(self.topics[topic].latched)),
            "md5sum": type_digest(kind),
            "message_definition": definition(kind),
            "topic": topic,
            "type": kind,
        }
        connection.send(write_header(answer))
        subscriber = Subscriber(node, connection)
        self.outgoing[topic].append(subscriber)
        connection.use(connection.incoming.clear, lambda: self._forget(topic, subscriber))
        self.changes += 1
        if topic in self.latched:
            connection.send(self.latched[topic])

    def _send(self, topic: str, subscriber: Subscriber, frame: bytes) -> None:
        if subscriber.connection.backlog_bytes > limits.BACKLOG_BYTES:
            waiting = subscriber.connection.backlog_bytes
            self._events.fail(f"{subscriber.node} subscribed to {topic} and does not read it: {waiting} bytes wait")
            subscriber.connection.close()
        else:
            subscriber.connection.send(frame)

    def _forget(self, topic: str, subscriber: Subscriber) -> None:
        # By identity: a node may have two connections.
        self.outgoing[topic] = [each for each in self.outgoing[topic] if each.connection is not subscriber.connection]

    def _fault(self, node: str, topic: str, fields: Mapping[str, str]) -> str:
        """Returns why a subscriber cannot be served; empty if it can."""
        own = self.topics.get(topic)
        if own is None:
            return f"the robot does not publish {topic[:200]!r}"
        asked = fields.get("md5sum", "")
        if asked in (ANY, type_digest(own.kind)):
            return ""
        kind = fields.get("type", "no type")[:200]
        fault = f"{topic} has {own.kind} with md5sum {type_digest(own.kind)}, not {kind} with {asked[:40]!r}"
        self._events.fail(f"{node} cannot subscribe: {fault}")
        return fault


_CHUNK_BYTES = 65536


class CommandSource(NamedTuple):
    """A connection to a node that publishes commands; what came and is no whole message yet."""

    topic: str
    node: str
    sock: socket.socket
    buffer: bytearray


class _Publisher(NamedTuple):
    topic: str
    node: str
    uri: str


class _Held(NamedTuple):
    topics: frozenset[str]
    send: Callable[[], None]
    timer: asyncio.TimerHandle


class Subscriptions:
    """All topics that the robot subscribes to.

    Attributes:
        incoming: Connections, in the order of topics' and nodes' names: so that of commands that come at once the same
            one is the last, whoever connected first.
        faults: Why a publisher could not be connected, by topic and node.
        changes: Grows with every connection that begins.
    """

    def __init__(self, events: EventLoop, tables: Registrations, calls: NodeCalls, topics: Sequence[Topic]) -> None:
        self._events, self._tables, self._calls = events, tables, calls
        self.topics: Mapping[str, Topic] = {topic.name: topic for topic in topics}
        self.incoming: list[CommandSource] = []
        self.faults: dict[tuple[str, str], str] = {}
        self.changes = 0
        self._known: set[_Publisher] = set()
        self._pending: set[_Publisher] = set()
        self._held: list[_Held] = []
        self._ready: list[_Held] = []

    def publishers_changed(self, topic: str) -> None:
        """Connects to publishers that are new."""
        now = {_Publisher(topic, *each) for each in self._tables.publishers.of(topic).items() if each[0] != ROBOT}
        gone = {each for each in self._known if each.topic == topic} - now
        # One that is gone closes its connection itself, after what it has sent.
        self._known -= gone
        for each in sorted(now - self._known):
            self._known.add(each)
            self._begin(each)

    def hold(self, topics: frozenset[str], send: Callable[[], None]) -> None:
        """Sends an answer when the publishers of these topics are connected, so that no first command is lost."""
        if not any(each.topic in topics for each in self._pending):
            send()
            return
        timer = self._events.loop.call_later(limits.HOLD_S, self._release, topics)
        self._held.append(_Held(topics, send, timer))
        self._events.busy += 1

    def take(self) -> list[tuple[str, bytes]]:
        """Returns the commands that have come since the last call: topic and message, a node's in their order."""
        found: list[tuple[str, bytes]] = []
        for source in tuple(self.incoming):
            ended = self._receive(source)
            found += [(source.topic, message) for message in self._messages(source)]
            if ended:
                self.incoming.remove(source)
                source.sock.close()
        return found

    def close(self) -> None:
        """Closes all connections."""
        for source in self.incoming:
            source.sock.close()
        self.incoming.clear()
        for held in (*self._held, *self._ready):
            held.timer.cancel()
        self._held.clear()
        self._ready.clear()

    def _begin(self, publisher: _Publisher) -> None:
        if len(self.incoming) + len(self._pending) >= limits.PUBLISHERS:
            self._events.fail(f"more than {limits.PUBLISHERS} nodes publish {', '.join(self.topics)}")
            return
        self._pending.add(publisher)
        self._events.busy += 1
        protocols: Value = [["TCPROS"]]
        asked = (ROBOT, publisher.topic, protocols)
        self._calls.call(publisher.uri, "requestTopic", asked, lambda answer: self._connect(publisher, answer))

    def _connect(self, publisher: _Publisher, answer: NodeAnswer) -> None:
        match answer.value:
            case ["TCPROS", str(), int(port), *_] if 0 < port < 65536:
                self._shake_hands(publisher, port)
            case _:
                self._finish(publisher, answer.fault or f"it offers {answer.value!r:.200} for TCPROS")

    def _shake_hands(self, publisher: _Publisher, port: int) -> None:
        try:
            _Handshake(self._events, self.topics[publisher.topic], port, lambda each: self._finish(publisher, each))
        except OSError as exc:
            self._finish(publisher, str(exc))

    def _finish(self, publisher: _Publisher, found: Connection | str) -> None:
        self._pending.discard(publisher)
        self._events.busy -= 1
        key = publisher.topic, publisher.node
        if isinstance(found, str):
            self.faults[key] = found
            self._known.discard(publisher)
        else:
            self.faults.pop(key, None)
            rest = bytearray(found.incoming)
            self.incoming.append(CommandSource(*key, found.detach(), rest))
            self.incoming.sort(key=lambda each: (each.topic, each.node))
            self.changes += 1
        self._release(frozenset())

    def _release(self, expired: frozenset[str]) -> None:
        """Sends the answers that need not wait any longer."""
        pending = {each.topic for each in self._pending}
        ready = [each for each in self._held if each.topics is expired or not each.topics & pending]
        self._held = [each for each in self._held if not any(each is other for other in ready)]
        for each in ready:
            each.timer.cancel()
            # rospy writes its header before it enters the connection in its list: an answer at once would come first.
            timer = self._events.loop.call_later(limits.LINK_S, self._answer, each)
            self._ready.append(each._replace(timer=timer))

    def _answer(self, held: _Held) -> None:
        self._ready = [each for each in self._ready if each.send is not held.send]
        self._events.busy -= 1
        held.send()

    def _receive(self, source: CommandSource) -> bool:
        """Takes what has come; returns whether the connection has ended."""
        before = len(source.buffer)
        while True:
            try:
                data = source.sock.recv(_CHUNK_BYTES)
            except (BlockingIOError, InterruptedError):
                return False
            except OSError:
                return True
            source.buffer.extend(data)
            if not data:
                return True
            if len(source.buffer) - before > limits.COMMAND_BYTES:
                self._events.fail(
                    f"{source.node} floods {source.topic}: more than {limits.COMMAND_BYTES} bytes at once"
                )
                return True
            if len(data) < _CHUNK_BYTES:
                return False

    def _messages(self, source: CommandSource) -> list[bytes]:
        found: list[bytes] = []
        buffer, at = source.buffer, 0
        while len(buffer) - at >= 4:
            (length,) = _LENGTH.unpack_from(buffer, at)
            if length > limits.COMMAND_MESSAGE_BYTES:
                self._events.fail(
                    f"{source.node} announces a message of {length} bytes on {source.topic}: "
                    f"at most {limits.COMMAND_MESSAGE_BYTES} are taken"
                )
                buffer.clear()
                return found
            if len(buffer) - at < 4 + length:
                break
            found.append(bytes(buffer[at + 4 : at + 4 + length]))
            at += 4 + length
        del buffer[:at]
        return found


class _Handshake:
    """The headers of a connection to a publisher."""

    def __init__(self, events: EventLoop, topic: Topic, port: int, done: Callable[[Connection | str], None]) -> None:
        self._events, self._topic, self._done = events, topic, done
        self._connection: Connection = events.connect(port, self._take, lambda: done("it closed the connection"))
        self._connection.limit_time(limits.CALL_S)
        # Without tcp_nodelay a node's second command within 40 ms would wait for an acknowledgement that is delayed.
        fields = {
            "callerid": ROBOT,
            "md5sum": type_digest(topic.kind),
            "tcp_nodelay": "1",
            "topic": topic.name,
            "type": topic.kind,
        }
        self._connection.send(write_header(fields))

    def _take(self) -> None:
        try:
            fields = take_header(self._connection.incoming)
        except HeaderError as exc:
            fields = {"error": str(exc)}
        if fields is None:
            return
        self._connection.limit_time(None)
        fault = fields.get("error", "")
        if not fault and fields.get("md5sum") != type_digest(self._topic.kind):
            fault = f"it has {fields.get('type', 'no type')[:200]} with md5sum {fields.get('md5sum', '')[:40]!r}"
        if not fault:
            self._done(self._connection)
            return
        caller = fields.get("callerid", "a node")[:200]
        takes = f"the robot takes {self._topic.kind} with md5sum {type_digest(self._topic.kind)}"
        self._events.fail(f"{caller} cannot command the robot on {self._topic.name}: {takes}; {fault[:500]}")
        self._connection.drop()
        self._done(fault)
