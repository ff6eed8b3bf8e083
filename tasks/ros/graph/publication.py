"""The robot's own topics: connections of those who subscribe, and what is sent to them."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from tasks.ros.graph.wire import graph_limits as limits
from tasks.ros.graph.wire.channel import Channel, Wire
from tasks.ros.graph.wire.connection_header import write_header
from tasks.ros.message.definition import ANY, definition, digest
from tasks.ros.message.stamp import frame_message

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
    channel: Channel


class Publications:
    """All topics that the robot publishes.

    Attributes:
        outgoing: Who is connected, by topic.
        latched: The last message of latched topics, with its length before it.
        changes: Grows with every connection that begins.
    """

    def __init__(self, wire: Wire, topics: Sequence[Topic]) -> None:
        self._wire = wire
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

    def connect(self, channel: Channel, fields: Mapping[str, str]) -> None:
        """Answers a subscriber's header, and lets it have what is published from now on."""
        node, topic = fields.get("callerid", "a node without callerid")[:200], fields.get("topic", "")
        fault = self._fault(node, topic, fields)
        if fault:
            channel.send(write_header({"error": fault}))
            channel.finish()
            return
        kind = self.topics[topic].kind
        answer = {
            "callerid": ROBOT,
            "latching": str(int(self.topics[topic].latched)),
            "md5sum": digest(kind),
            "message_definition": definition(kind),
            "topic": topic,
            "type": kind,
        }
        channel.send(write_header(answer))
        subscriber = Subscriber(node, channel)
        self.outgoing[topic].append(subscriber)
        channel.use(channel.incoming.clear, lambda: self._forget(topic, subscriber))
        self.changes += 1
        if topic in self.latched:
            channel.send(self.latched[topic])

    def _send(self, topic: str, subscriber: Subscriber, frame: bytes) -> None:
        if subscriber.channel.backlog_bytes > limits.BACKLOG_BYTES:
            waiting = subscriber.channel.backlog_bytes
            self._wire.fail(f"{subscriber.node} subscribed to {topic} and does not read it: {waiting} bytes wait")
            subscriber.channel.close()
        else:
            subscriber.channel.send(frame)

    def _forget(self, topic: str, subscriber: Subscriber) -> None:
        # By identity: a node may have two connections.
        self.outgoing[topic] = [each for each in self.outgoing[topic] if each.channel is not subscriber.channel]

    def _fault(self, node: str, topic: str, fields: Mapping[str, str]) -> str:
        """Returns why a subscriber cannot be served; empty if it can."""
        own = self.topics.get(topic)
        if own is None:
            return f"the robot does not publish {topic[:200]!r}"
        asked = fields.get("md5sum", "")
        if asked in (ANY, digest(own.kind)):
            return ""
        kind = fields.get("type", "no type")[:200]
        fault = f"{topic} has {own.kind} with md5sum {digest(own.kind)}, not {kind} with {asked[:40]!r}"
        self._wire.fail(f"{node} cannot subscribe: {fault}")
        return fault
