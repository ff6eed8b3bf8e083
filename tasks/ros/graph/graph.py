"""A ROS 1 graph of one episode: master, parameters and the robot's node in this process, without ROS."""

import asyncio
import socket
from collections.abc import Callable, Sequence

from tasks.ros.graph.master import Master
from tasks.ros.graph.method import Dispatch
from tasks.ros.graph.parameter_tree import ParameterTree
from tasks.ros.graph.publication import ROBOT, Publications, Subscriber, Topic
from tasks.ros.graph.registrations import Registrations, Served
from tasks.ros.graph.robot_service import SERVICES, RobotServices
from tasks.ros.graph.ros1_node import RobotNode
from tasks.ros.graph.subscription import Source, Subscriptions
from tasks.ros.graph.wire.channel import HOST, Wire
from tasks.ros.graph.wire.http import HttpConnection
from tasks.ros.graph.wire.node_call import NodeCalls
from tasks.ros.graph.wire.xml_rpc import Value


class Graph:
    """One episode's nodes, topics and parameters, and the robot's own connections.

    It listens on two ports of the loopback that the kernel chooses. It lives in callbacks of the loop: nothing happens
    but while the loop runs.

    Args:
        loop: Serves all graphs of a chunk.
        publishes: The robot's own topics.
        subscribes: The topics of its commands.
        new_socket: Makes TCP sockets, such as in an episode's own network namespace.

    Attributes:
        uri: The master's address, for ``ROS_MASTER_URI``.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        publishes: Sequence[Topic],
        subscribes: Sequence[Topic],
        new_socket: Callable[[], socket.socket] = socket.socket,
    ) -> None:
        self._wire = Wire(loop, new_socket)
        self._tables = Registrations()
        self.parameters = ParameterTree()
        self.services = RobotServices()
        calls = NodeCalls(self._wire)
        self._publications = Publications(self._wire, publishes)
        self._subscriptions = Subscriptions(self._wire, self._tables, calls, subscribes)
        node = RobotNode(self._wire, self._publications, self._subscriptions, self.services)
        port = self._wire.listen(self._serve)
        self.uri = f"http://{HOST}:{port}/"
        changed = self._subscriptions.publishers_changed
        self._master = Master(
            self.uri,
            tables=self._tables,
            parameters=self.parameters,
            calls=calls,
            publishers_changed=changed,
            robot=ROBOT,
        )
        self._dispatch = Dispatch({**node.methods(self.uri), **self._master.methods()}, self._subscriptions.hold)
        self._register_robot(publishes, subscribes, node.port)
        self.parameters.set("/use_sim_time", value=True)

    @property
    def busy(self) -> int:
        """Returns how many answers of nodes the graph waits for: no episode is quiet while there are any."""
        return self._wire.busy

    @property
    def served(self) -> int:
        """Returns a number that grows with every part of a request and every connection."""
        return self._wire.served

    @property
    def changes(self) -> int:
        """Returns a number that grows with every registration and every connection of the robot."""
        return self._tables.changes + self._publications.changes + self._subscriptions.changes

    @property
    def failure(self) -> str:
        """Returns why the episode cannot go on, for a person; empty while it can."""
        return self._wire.failure

    @property
    def outgoing(self) -> dict[str, list[Subscriber]]:
        """Returns who is connected to the robot's topics."""
        return self._publications.outgoing

    @property
    def incoming(self) -> list[Source]:
        """Returns whose commands the robot is connected to."""
        return self._subscriptions.incoming

    @property
    def tags(self) -> dict[str, str]:
        """Returns what the application gave to ``/robomaker/job/add_tags``."""
        return self.services.tags

    @property
    def cancelled(self) -> bool:
        """Returns whether the application called ``/robomaker/job/cancel``."""
        return self.services.cancelled

    def publish(self, topic: str, data: bytes) -> bool:
        """Sends a message of one of the robot's topics; returns whether anybody listens.

        A latched one is kept for those who come. Nothing is thrown away: a subscriber that does not read fails its
        episode.

        Args:
            topic: Its name.
            data: The message, without its length.
        """
        return self._publications.publish(topic, data)

    def keep(self, topic: str, data: bytes) -> None:
        """Keeps the message that whoever subscribes to a latched topic gets at once, and sends nothing now."""
        self._publications.keep(topic, data)

    def take(self) -> list[tuple[str, bytes]]:
        """Returns the commands that have come since the last call: topic and message, in the order of nodes' names."""
        return self._subscriptions.take()

    def nodes(self) -> set[str]:
        """Returns the names of the application's nodes."""
        return set(self._tables.nodes) - {ROBOT}

    def publishers(self, topic: str) -> set[str]:
        """Returns the nodes that are registered as publishers."""
        return set(self._tables.publishers.of(topic)) - {ROBOT}

    def subscribers(self, topic: str) -> set[str]:
        """Returns the nodes that are registered as subscribers."""
        return set(self._tables.subscribers.of(topic)) - {ROBOT}

    def unconnected(self) -> list[str]:
        """Returns which registrations have no connection to the robot yet, for a person."""
        found: list[str] = []
        for topic, connected in self.outgoing.items():
            missing = self.subscribers(topic) - {each.node for each in connected}
            found += [f"{node} subscribed to {topic}, and has not connected" for node in sorted(missing)]
        for topic in self._subscriptions.topics:
            missing = self.publishers(topic) - {each.node for each in self.incoming if each.topic == topic}
            for node in sorted(missing):
                fault = self._subscriptions.faults.get((topic, node), "it is not connected yet")
                found.append(f"{node} publishes {topic}: {fault}")
        return found

    def connected(self) -> bool:
        """Returns whether all who subscribe to the robot or command it have their connections."""
        return not self.busy and not self.unconnected()

    def set_parameter(self, name: str, value: Value) -> None:
        """Sets a parameter as a node would, and tells those who follow it.

        Args:
            name: Absolute.
            value: What XML-RPC has a form for.

        Raises:
            ParameterError: If it has none for it, or it is too big.
        """
        self._master.set(ROBOT, name, value)

    def close(self) -> None:
        """Closes every port and connection; a second time does nothing."""
        self._subscriptions.close()
        self._wire.close()

    def _serve(self, sock: socket.socket) -> None:
        HttpConnection(self._wire, sock, self._dispatch.answer)

    def _register_robot(self, publishes: Sequence[Topic], subscribes: Sequence[Topic], port: int) -> None:
        self._tables.enter(ROBOT, self.uri)
        for topics, table in ((publishes, self._tables.publishers), (subscribes, self._tables.subscribers)):
            for topic in topics:
                self._tables.add(table, topic.name, ROBOT)
                self._tables.type_topic(topic.name, topic.kind, publisher=True)
        for name in SERVICES:
            self._tables.serve(name, ROBOT, Served(ROBOT, f"rosrpc://{HOST}:{port}").uri)
