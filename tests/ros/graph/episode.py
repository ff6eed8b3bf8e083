"""A graph and its loop, and nodes that are played by sockets and XML-RPC servers of this process."""

import asyncio
import socket
import struct
import threading
import xmlrpc.client
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self, TypeVar
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

from tasks.ros.graph.gazebo_services import GazeboServices
from tasks.ros.graph.graph import Graph
from tasks.ros.graph.topic import Topic, take_header, write_header
from tasks.ros.message.definition import type_digest

T = TypeVar("T")
PUBLISHES = (
    Topic("/clock", "rosgraph_msgs/Clock"),
    Topic("/scan", "sensor_msgs/LaserScan"),
    Topic("/map", "nav_msgs/OccupancyGrid", latched=True),
)
SUBSCRIBES = (Topic("/cmd_vel", "geometry_msgs/Twist"),)


class Episode:
    """A graph whose loop runs while something is done in a thread beside it.

    Args:
        gazebo: Answers for Gazebo.

    Attributes:
        faults: What the loop's callbacks raised: there is to be nothing.
    """

    def __init__(self, gazebo: GazeboServices | None = None) -> None:
        self.loop = asyncio.new_event_loop()
        self.graph = Graph(self.loop, PUBLISHES, SUBSCRIBES, gazebo=gazebo)
        self.faults: list[object] = []
        self.loop.set_exception_handler(lambda _, context: self.faults.append(context))
        self.master = xmlrpc.client.ServerProxy(self.graph.uri, allow_none=True)
        self.port = int(self.graph.uri.rsplit(":", 1)[1].rstrip("/"))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.graph.close()
        self.master("close")()
        self.loop.run_until_complete(self.loop.shutdown_default_executor())
        self.loop.close()
        assert not self.faults

    def during(self, function: Callable[..., T], *arguments: object) -> T:
        """Returns what a function returns that runs in a thread while the graph is served."""
        return self.loop.run_until_complete(asyncio.to_thread(function, *arguments))

    def call(self, method: str, *arguments: object, caller: str = "/node") -> list[Any]:
        """Returns the answer to a call of the API: code, message, value."""
        return self.during(getattr(self.master, method), caller, *arguments)

    def serve_until(self, true: Callable[[], bool]) -> None:
        """Serves the graph until something is true."""

        async def wait() -> None:
            while not true():
                await asyncio.sleep(0.001)

        self.loop.run_until_complete(wait())

    def pass_time(self, seconds: float) -> None:
        """Lets so much time pass at once for the graph, whose limits end then."""
        before = self.loop.time
        self.loop.time = lambda: before() + seconds

    def topic_port(self) -> int:
        """Returns the port of the robot's TCPROS connections."""
        return int(self.call("requestTopic", "/scan", [["TCPROS"]])[2][2])

    def connect(self, fields: dict[str, str]) -> tuple[socket.socket, dict[str, str]]:
        """Returns a connection to the robot's node, and its answer to a header."""
        return self.during(open_connection, self.topic_port(), fields)

    def subscribe(self, topic: str = "/scan", md5sum: str = "*") -> tuple[socket.socket, dict[str, str]]:
        """Returns a subscriber's connection and the answer to its header."""
        return self.connect({"callerid": "/node", "topic": topic, "md5sum": md5sum, "type": "*"})


def open_connection(port: int, fields: dict[str, str]) -> tuple[socket.socket, dict[str, str]]:
    """Returns a TCPROS connection, and the answer to its header."""
    sock = socket.create_connection(("127.0.0.1", port))
    sock.sendall(write_header(fields))
    return sock, read_header(sock)


def read_header(sock: socket.socket) -> dict[str, str]:
    """Returns the header that comes next."""
    data = bytearray(read_exactly(sock, 4))
    data += read_exactly(sock, struct.unpack("<I", data)[0])
    found = take_header(data)
    assert found is not None
    return found


def read_message(sock: socket.socket) -> bytes:
    """Returns the message that comes next."""
    return read_exactly(sock, struct.unpack("<I", read_exactly(sock, 4))[0])


def read_exactly(sock: socket.socket, count: int) -> bytes:
    """Returns so many bytes; fewer at the end of the connection."""
    data = b""
    while len(data) < count:
        part = sock.recv(count - len(data))
        if not part:
            return data
        data += part
    return data


class _KeptConnections(SimpleXMLRPCRequestHandler):
    rpc_paths = ()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class's name
        pass


class PlayedNode:
    """A node that answers its slave API and publishes commands, each in a thread.

    Attributes:
        calls: What it was called with, in this order: method and arguments.
        first: Frames that it sends at once to whoever subscribes.
        kind: The type of what it publishes.
        links: What it answers of its connections, one answer after the other; the last one from then on.
    """

    def __init__(self, name: str = "/node", kind: str = "geometry_msgs/Twist", first: bytes = b"") -> None:
        self.links: list[list[object]] = [[]]
        self.name, self.kind, self.first = name, kind, first
        self.calls: list[tuple[object, ...]] = []
        self.connections: list[socket.socket] = []
        self._server = SimpleXMLRPCServer(("127.0.0.1", 0), _KeptConnections, logRequests=False, allow_none=True)
        self._listener = socket.create_server(("127.0.0.1", 0))
        for method in ("publisherUpdate", "paramUpdate", "shutdown"):
            self._server.register_function(self._noted(method), method)
        self._server.register_function(self._request_topic, "requestTopic")
        self._server.register_function(self._links, "getBusInfo")
        self._threads = [
            threading.Thread(target=self._server.serve_forever, args=(0.01,)),
            threading.Thread(target=self._accept),
        ]
        for each in self._threads:
            each.start()

    @property
    def uri(self) -> str:
        """Returns its address."""
        return f"http://127.0.0.1:{self._server.server_address[1]}/"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        for each in self._threads:
            each.join()
        for each in self.connections:
            each.close()

    def _noted(self, method: str) -> Callable[..., list[object]]:
        def note(*arguments: object) -> list[object]:
            self.calls.append((method, *arguments))
            return [1, "", 0]

        return note

    def _links(self, *_: object) -> list[object]:
        return [1, "", self.links.pop(0) if self.links[1:] else self.links[0]]

    def _request_topic(self, *arguments: object) -> list[object]:
        self.calls.append(("requestTopic", *arguments))
        return [1, "", ["TCPROS", "127.0.0.1", self._listener.getsockname()[1]]]

    def _accept(self) -> None:
        while True:
            try:
                sock, _ = self._listener.accept()
            except OSError:
                return
            self.connections.append(sock)
            asked = read_header(sock)
            if asked["md5sum"] != type_digest(self.kind):
                sock.sendall(write_header({"error": f"I have {self.kind}"}))
                continue
            answer = {
                "callerid": self.name,
                "md5sum": type_digest(self.kind),
                "type": self.kind,
                "topic": asked["topic"],
            }
            sock.sendall(write_header(answer) + self.first)
