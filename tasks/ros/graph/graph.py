"""One episode's ROS 1 graph: a master, the robot's node, its topics and services, on one event loop.

RoboMaker serves the names and types of its services in every simulation
(github.com/aws-robotics/aws-robomaker-simulation-ros-pkgs, package robomaker_simulation_msgs).
"""

import asyncio
import functools
import os
import socket
import struct
from collections.abc import Callable, Mapping, Sequence
from collections.abc import Set as AbstractSet

from tasks.ros.graph import graph_limits as limits
from tasks.ros.graph.event_loop import HOST, Connection, EventLoop
from tasks.ros.graph.gazebo_services import (
    GAZEBO_SERVICES,
    SET_MODEL_STATE,
    SET_MODEL_STATE_KIND,
    GazeboServices,
)
from tasks.ros.graph.master import (
    KEY,
    LIST,
    TEXT,
    TOPIC,
    VALUE,
    Dispatch,
    Master,
    Method,
    Outcome,
    Registrations,
    Served,
)
from tasks.ros.graph.parameter_tree import ParameterTree
from tasks.ros.graph.topic import (
    ROBOT,
    CommandSource,
    HeaderError,
    Publications,
    Subscriber,
    Subscriptions,
    Topic,
    take_header,
    write_header,
)
from tasks.ros.graph.xml_rpc import HttpConnection, NodeAnswer, NodeCalls, Value
from tasks.ros.message.definition import ANY, type_digest
from tasks.ros.message.navigation import (
    MOVE_BASE,
    MOVE_BASE_KIND,
    MOVE_BASE_RESULT,
    MOVE_BASE_RESULT_KIND,
    Navigation,
)
from tasks.ros.message.ros_messages import (
    REQUEST_BYTES,
    frame_message,
    joined_tags,
    read_tag_keys,
    read_tags,
    write_outcome,
    write_tags,
)

_LENGTH = struct.Struct("<I")
SERVICES: Mapping[str, str] = {
    "/robomaker/job/add_tags": "robomaker_simulation_msgs/AddTags",
    "/robomaker/job/cancel": "robomaker_simulation_msgs/Cancel",
    "/robomaker/job/list_tags": "robomaker_simulation_msgs/ListTags",
    "/robomaker/job/remove_tags": "robomaker_simulation_msgs/RemoveTags",
}
"""Types by name."""


class RobotServices:
    """Answers requests to the robot's services.

    Attributes:
        tags: What the application gave.
        cancelled: Whether it asked for the end of its job.
    """

    def __init__(self, gazebo: GazeboServices | None = None) -> None:
        self.tags: dict[str, str] = {}
        self.kinds = {**SERVICES, **(GAZEBO_SERVICES if gazebo else {})}
        self.cancelled = False
        self._functions: dict[str, Callable[[bytes], bytes]] = {
            "/robomaker/job/add_tags": self._add_tags,
            "/robomaker/job/cancel": self._cancel,
            "/robomaker/job/list_tags": self._list_tags,
            "/robomaker/job/remove_tags": self._remove_tags,
            **(gazebo.functions if gazebo else {}),
        }

    def connect(self, connection: Connection, fields: Mapping[str, str]) -> None:
        """Answers a client's header, and its requests from now on."""
        service = fields.get("service", "")
        kind = self.kinds.get(service)
        if kind is None:
            fault = f"the robot has no service {service[:200]!r}"
        elif fields.get("md5sum") not in (ANY, type_digest(kind)):
            fault = f"{service} is {kind} with md5sum {type_digest(kind)}, not {fields.get('md5sum', '')[:40]!r}"
        else:
            fault = ""
        if kind is None or fault:
            connection.send(write_header({"error": fault}))
            connection.finish()
            return
        answer = {
            "callerid": ROBOT,
            "md5sum": type_digest(kind),
            "request_type": f"{kind}Request",
            "response_type": f"{kind}Response",
            "type": kind,
        }
        connection.send(write_header(answer))
        if fields.get("probe") == "1":
            connection.finish()
            return
        kept = fields.get("persistent", "0").lower() in ("1", "true")
        connection.use(lambda: self._take(connection, service, kept=kept), lambda: None)
        self._take(connection, service, kept=kept)

    def _take(self, connection: Connection, service: str, *, kept: bool) -> None:
        incoming = connection.incoming
        while not connection.closed and len(incoming) >= 4:
            (length,) = _LENGTH.unpack_from(incoming)
            if length > REQUEST_BYTES:
                fault = f"{service}: a request of {length} bytes, {REQUEST_BYTES} are taken"
                connection.send(b"\0" + frame_message(fault.encode()))
                connection.finish()
                return
            if len(incoming) < 4 + length:
                return
            request = bytes(incoming[4 : 4 + length])
            del incoming[: 4 + length]
            connection.send(self._answer(service, request))
            if not kept:
                connection.finish()
                return

    def _answer(self, service: str, request: bytes) -> bytes:
        """Returns the response after a 1, or a text after a 0 if the request cannot be read."""
        try:
            return b"\1" + frame_message(self._functions[service](request))
        except ValueError as exc:
            return b"\0" + frame_message(f"{service}: {exc}".encode())

    def _add_tags(self, request: bytes) -> bytes:
        given = read_tags(request)
        try:
            self.tags = joined_tags(self.tags, given)
        except ValueError as exc:
            return write_outcome(success=False, message=str(exc))
        return write_outcome(success=True, message="")

    def _remove_tags(self, request: bytes) -> bytes:
        for key in read_tag_keys(request):
            self.tags.pop(key, None)
        return write_outcome(success=True, message="")

    def _list_tags(self, _: bytes) -> bytes:
        return write_outcome(success=True, message="") + write_tags(self.tags)

    def _cancel(self, _: bytes) -> bytes:
        self.cancelled = True
        return write_outcome(success=True, message="")


class Ros1Node:
    """The node that publishes what the robot senses, and subscribes to its commands.

    Attributes:
        port: Of its TCPROS connections.
    """

    def __init__(
        self, events: EventLoop, publications: Publications, subscriptions: Subscriptions, services: RobotServices
    ) -> None:
        self._events, self._services = events, services
        self._publications, self._subscriptions = publications, subscriptions
        self.port = events.listen(self._accept)

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
        connection = self._events.connection(sock, lambda: self._take(connection), lambda: None)
        connection.limit_time(limits.REQUEST_S)

    def _take(self, connection: Connection) -> None:
        """Reads the header that a connection begins with: it is for a service or a topic."""
        try:
            fields = take_header(connection.incoming)
        except HeaderError as exc:
            connection.send(write_header({"error": str(exc)}))
            connection.finish()
            return
        if fields is None:
            return
        connection.limit_time(None)
        chosen = self._services if "service" in fields else self._publications
        chosen.connect(connection, fields)


class NodeLinks:
    """Whether what nodes registered became connections, which no look at their threads tells.

    roscpp looks each tenth of a second for whom to connect to, and again whether it is through; until then it sleeps
    as ever. So nodes are asked to whom they are connected (wiki.ros.org/ROS/Slave_API, ``getBusInfo``).

    Args:
        tables: What is registered.
        calls: To nodes.
        unconnected: Returns which connections the robot lacks.
    """

    def __init__(self, tables: Registrations, calls: NodeCalls, unconnected: Callable[[], list[str]]) -> None:
        self._tables, self._calls, self._unconnected = tables, calls, unconnected
        self._complete, self._asked = 0, -1
        # Subscriber, topic and the publisher's address; of the robot's connections, what it lacks.
        self._found: set[tuple[str, ...]] = set()
        self._hopeless: set[tuple[str, ...]] = set()

    def complete(self) -> bool:
        """Returns whether all are connected as of the last answers; asks nodes that lack a connection."""
        added = self._tables.added
        if added == self._complete:
            return True
        if added != self._asked:  # one that registered once more connects once more
            self._asked = added
            self._found.clear()
        missing = self._missing()
        if not missing:
            self._complete = added
        for node in sorted({node for node, *links in missing if links}):
            self._calls.call(self._tables.nodes[node], "getBusInfo", (ROBOT,), functools.partial(self._hear, node))
        return not missing

    def give_up(self) -> None:
        """Waits no more for those that are missing: such as nodes that take a topic for one of another type."""
        self._hopeless |= self._missing()
        self._complete = self._tables.added

    def _missing(self) -> set[tuple[str, ...]]:
        tables = self._tables
        wanted = {
            (node, topic, uri)
            for topic, nodes in tables.subscribers.state()
            for name, uri in tables.publishers.of(topic).items()
            for node in nodes
            if name not in (node, ROBOT) and node != ROBOT
        }
        return {*wanted, *((each,) for each in self._unconnected())} - self._found - self._hopeless

    def _hear(self, node: str, answer: NodeAnswer) -> None:
        heard = set[tuple[str, ...]]()
        for each in answer.value if isinstance(answer.value, list) else ():
            match each:
                case [_, str(uri), "i", _, str(topic), *_]:
                    heard.add((node, topic, uri))
                case _:
                    pass
        self._found |= heard & self._missing()  # of whatever it tells, no more than is asked for stays


def _types(topics: Sequence[Topic]) -> Value:
    return [[topic.name, topic.kind] for topic in topics]


class Graph:
    """One episode's nodes, topics and parameters, and the robot's own connections.

    It listens on two ports of the loopback that the kernel chooses. It lives in callbacks of the loop: nothing happens
    but while the loop runs.

    Args:
        loop: Serves all graphs of a chunk.
        publishes: The robot's own topics.
        subscribes: The topics of its commands.
        new_socket: Makes TCP sockets, such as in an episode's own network namespace.
        gazebo: Answers for Gazebo; None if nobody does.
        navigates: Whether it sends goals to ``move_base`` as actions.

    Attributes:
        navigation: How those go.
        uri: The master's address, for ``ROS_MASTER_URI``.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        publishes: Sequence[Topic],
        subscribes: Sequence[Topic],
        new_socket: Callable[[], socket.socket] = socket.socket,
        gazebo: GazeboServices | None = None,
        *,
        navigates: bool = False,
    ) -> None:
        self._events = EventLoop(loop, new_socket)
        self.navigation, self._heard = Navigation(), dict[str, Callable[[bytes], object]]()
        if gazebo is not None:
            subscribes = (*subscribes, Topic(SET_MODEL_STATE, SET_MODEL_STATE_KIND))
            self._heard[SET_MODEL_STATE] = gazebo.set_state
        if navigates:
            publishes = (*publishes, Topic(MOVE_BASE, MOVE_BASE_KIND))
            subscribes = (*subscribes, Topic(MOVE_BASE_RESULT, MOVE_BASE_RESULT_KIND))
            self._heard[MOVE_BASE_RESULT] = self.navigation.hear
        self._tables = Registrations()
        self.parameters = ParameterTree()
        self.services = RobotServices(gazebo)
        calls = NodeCalls(self._events)
        self._publications = Publications(self._events, publishes)
        self._subscriptions = Subscriptions(self._events, self._tables, calls, subscribes)
        node = Ros1Node(self._events, self._publications, self._subscriptions, self.services)
        port = self._events.listen(self._serve)
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
        self._links = NodeLinks(self._tables, calls, self.unconnected)
        self._dispatch = Dispatch({**node.methods(self.uri), **self._master.methods()}, self._subscriptions.hold)
        self._register_robot(publishes, subscribes, node.port)
        self.parameters.set("/use_sim_time", value=True)

    @property
    def busy(self) -> int:
        """Returns how many answers of nodes the graph waits for: no episode is quiet while there are any."""
        return self._events.busy

    @property
    def served(self) -> int:
        """Returns a number that grows with every part of a request and every connection."""
        return self._events.served

    @property
    def changes(self) -> int:
        """Returns a number that grows with every registration and every connection of the robot."""
        return self._tables.changes + self._publications.changes + self._subscriptions.changes

    @property
    def failure(self) -> str:
        """Returns why the episode cannot go on, for a person; empty while it can."""
        return self._events.failure

    def take_asked(self) -> set[tuple[str, str]]:
        """Returns which nodes looked for a service since the last call, and of which node."""
        return self._master.take_asked()

    @property
    def outgoing(self) -> dict[str, list[Subscriber]]:
        """Returns who is connected to the robot's topics."""
        return self._publications.outgoing

    @property
    def incoming(self) -> list[CommandSource]:
        """Returns whose commands the robot is connected to; who only sets it elsewhere commands nothing."""
        return [each for each in self._subscriptions.incoming if each.topic not in self._heard]

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
        commands = list[tuple[str, bytes]]()
        for topic, data in self._subscriptions.take():
            if topic not in self._heard:
                commands.append((topic, data))
                continue
            try:
                self._heard[topic](data)
            except ValueError as exc:
                self._events.fail(f"{topic}: {exc}")
        return commands

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
        sources = self._subscriptions.incoming
        for topic in self._subscriptions.topics:
            missing = self.publishers(topic) - {each.node for each in sources if each.topic == topic}
            for node in sorted(missing):
                fault = self._subscriptions.faults.get((topic, node), "it is not connected yet")
                found.append(f"{node} publishes {topic}: {fault}")
        return found

    def linked(self) -> bool:
        """Returns whether all who registered are connected; asks nodes of which that is not known yet."""
        return self._links.complete()

    def give_links_up(self) -> None:
        """Waits no more for nodes that did not connect so far."""
        self._links.give_up()

    def forget(self, ended: AbstractSet[int]) -> None:
        """Does nothing with the numbers of nodes' processes that ended: the kernel closed their connections."""

    def gaps(self) -> list[str]:
        """Returns what nodes say or wait for in vain, for a person: commands elsewhere, topics nobody publishes."""
        tables, commands = self._tables, self._subscriptions.topics
        kinds = {each.kind for each in commands.values()}
        found = [
            f"{', '.join(sorted(nodes))} publishes {tables.types[topic]} on {topic}, to which nobody subscribes"
            for topic, nodes in tables.publishers.state()
            if topic not in commands and tables.types.get(topic) in kinds and not tables.subscribers.of(topic)
        ]
        found += [
            f"{', '.join(sorted(nodes))} subscribes to {topic}, which nobody publishes"
            for topic, nodes in tables.subscribers.state()
            if topic not in commands and not tables.publishers.of(topic)
        ]
        return sorted(found)

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
        self._events.close()

    def _serve(self, sock: socket.socket) -> None:
        HttpConnection(self._events, sock, self._dispatch.answer)

    def _register_robot(self, publishes: Sequence[Topic], subscribes: Sequence[Topic], port: int) -> None:
        self._tables.enter(ROBOT, self.uri)
        for topics, table in ((publishes, self._tables.publishers), (subscribes, self._tables.subscribers)):
            for topic in topics:
                self._tables.add(table, topic.name, ROBOT)
                self._tables.type_topic(topic.name, topic.kind, publisher=True)
        for name in self.services.kinds:
            self._tables.serve(name, ROBOT, Served(ROBOT, f"rosrpc://{HOST}:{port}").uri)
