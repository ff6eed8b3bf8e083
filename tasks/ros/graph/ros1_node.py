"""The robot's own node: its slave API, and whoever connects to it over TCPROS (wiki.ros.org/ROS/Slave_API)."""

import os
import socket
from collections.abc import Mapping, Sequence

from tasks.ros.graph.method import KEY, LIST, TEXT, TOPIC, VALUE, Method, Outcome
from tasks.ros.graph.publication import Publications, Topic
from tasks.ros.graph.robot_service import RobotServices
from tasks.ros.graph.subscription import Subscriptions
from tasks.ros.graph.wire import graph_limits as limits
from tasks.ros.graph.wire.channel import HOST, Channel, Wire
from tasks.ros.graph.wire.connection_header import HeaderError, take_header, write_header
from tasks.ros.graph.wire.xml_rpc import Value


class RobotNode:
    """The node that publishes what the robot senses, and subscribes to its commands.

    Attributes:
        port: Of its TCPROS connections.
    """

    def __init__(
        self, wire: Wire, publications: Publications, subscriptions: Subscriptions, services: RobotServices
    ) -> None:
        self._wire, self._services = wire, services
        self._publications, self._subscriptions = publications, subscriptions
        self.port = wire.listen(self._accept)

    def methods(self, master_uri: str) -> Mapping[str, Method]:
        """Returns the slave API by its methods' names."""
        return {
            "requestTopic": Method(self._request_topic, (TOPIC, LIST)),
            "publisherUpdate": Method(lambda *_: (1, "", 0), (TOPIC, LIST)),
            "paramUpdate": Method(lambda *_: (1, "", 0), (KEY, VALUE)),
            "getBusInfo": Method(lambda _: (1, "", self._connections())),
            "getBusStats": Method(lambda _: (1, "", [[], [], []])),
            "getMasterUri": Method(lambda _: (1, "", master_uri)),
            "getPid": Method(lambda _: (1, "", os.getpid())),
            "getPublications": Method(lambda _: (1, "", _types([*self._publications.topics.values()]))),
            "getSubscriptions": Method(lambda _: (1, "", _types([*self._subscriptions.topics.values()]))),
            "shutdown": Method(lambda *_: (-1, "the robot's node ends with its episode", 0), (TEXT,), optional=1),
        }

    def _request_topic(self, _: str, topic: str, protocols: list[Value]) -> Outcome:
        if topic not in self._publications.topics:
            return 0, f"the robot does not publish {topic}", 0
        if not any(isinstance(each, list) and each[:1] == ["TCPROS"] for each in protocols):
            return 0, f"{topic} is there over TCPROS", 0
        return 1, "", ["TCPROS", HOST, self.port]

    def _connections(self) -> Value:
        ends = [(each.node, "o", topic) for topic, nodes in self._publications.outgoing.items() for each in nodes]
        ends += [(each.node, "i", each.topic) for each in self._subscriptions.incoming]
        return [[number, node, way, "TCPROS", topic, True] for number, (node, way, topic) in enumerate(ends)]

    def _accept(self, sock: socket.socket) -> None:
        channel = self._wire.channel(sock, lambda: self._take(channel), lambda: None)
        channel.limit_time(limits.REQUEST_S)

    def _take(self, channel: Channel) -> None:
        """Reads the header that a connection begins with: it is for a service or a topic."""
        try:
            fields = take_header(channel.incoming)
        except HeaderError as exc:
            channel.send(write_header({"error": str(exc)}))
            channel.finish()
            return
        if fields is None:
            return
        channel.limit_time(None)
        chosen = self._services if "service" in fields else self._publications
        chosen.connect(channel, fields)


def _types(topics: Sequence[Topic]) -> Value:
    return [[topic.name, topic.kind] for topic in topics]
