"""What a node may do to a graph: the graph still answers others, and what it keeps is bounded."""

import socket
import xmlrpc.client
from collections.abc import Generator
from contextlib import contextmanager, suppress

import pytest

from tasks.ros.graph import graph_limits
from tests.ros.graph.episode import Episode, PlayedNode, read_exactly, read_header
from tests.ros.graph.test_xml_rpc import BOMB


@contextmanager
def connected(port: int) -> Generator[socket.socket]:
    with socket.create_connection(("127.0.0.1", port)) as sock:
        yield sock


def post(body: bytes, *, length: int | None = None) -> bytes:
    return (
        f"POST /RPC2 HTTP/1.1\r\nHost: x\r\nContent-Length: {len(body) if length is None else length}\r\n\r\n".encode()
        + body
    )


def _answer(sock: socket.socket) -> tuple[str, bytes]:
    """Returns the first line and the body of an answer."""
    data = b""
    while b"\r\n\r\n" not in data:
        part = sock.recv(65536)
        if not part:
            return "", b""
        data += part
    head, _, body = data.partition(b"\r\n\r\n")
    length = next(int(line[15:]) for line in head.split(b"\r\n") if line.startswith(b"Content-Length:"))
    return head.split(b"\r\n")[0].decode(), body + read_exactly(sock, length - len(body))


def _send(episode: Episode, data: bytes) -> tuple[str, bytes]:
    with connected(episode.port) as sock:
        episode.during(sock.sendall, data)
        return episode.during(_answer, sock)


@pytest.mark.parametrize(
    "body",
    [BOMB, b"garbage", b"<methodCall>", b"\x00" * 100, xmlrpc.client.dumps((1,), methodresponse=True).encode()],
)
def test_garbage_is_answered_with_a_fault(episode: Episode, body: bytes):
    line, answer = _send(episode, post(body))
    assert line == "HTTP/1.1 200 OK"
    assert b"faultString" in answer or b"no method" in answer
    assert episode.call("getUri")[2] == episode.graph.uri


@pytest.mark.parametrize(
    ("data", "status"),
    [
        (b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", 405),
        (b"HEAD / HTTP/1.1\r\nHost: x\r\n\r\n", 405),
        (b"POST / HTTP/1.1\r\n\r\n", 400),
        (b"POST / HTTP/1.1\r\nHost: x\r\n\r\n", 411),
        (post(b"", length=10**12), 413),
        (b"POST / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n", 501),
        (b"a" * 100_000, 431),
        (b"\r\n\r\n", 400),
    ],
)
def test_what_is_no_call_over_http_is_refused(episode: Episode, data: bytes, status: int):
    assert _send(episode, data)[0].split()[1] == str(status)
    assert episode.call("getUri")[0] == 1


@pytest.mark.parametrize("data", [b"", b"POST", post(b"", length=100) + b"half"])
def test_a_request_that_never_ends_is_dropped(episode: Episode, monkeypatch: pytest.MonkeyPatch, data: bytes):
    monkeypatch.setattr(graph_limits, "REQUEST_S", 3600.0)
    with connected(episode.port) as sock:
        sock.sendall(data)
        assert episode.call("getUri")[0] == 1
        assert episode.graph.busy == 0
        if data:
            episode.pass_time(3600.0)
            assert episode.during(sock.recv, 1) == b""


def test_a_connection_that_says_nothing_to_the_robot_is_dropped(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "REQUEST_S", 3600.0)
    port = episode.topic_port()
    served = episode.graph.served
    with connected(port) as sock:
        episode.serve_until(lambda: episode.graph.served > served)
        episode.pass_time(3600.0)
        assert episode.during(sock.recv, 1) == b""


def test_a_call_in_single_bytes_is_answered(episode: Episode):
    def dribble() -> tuple[str, bytes]:
        with connected(episode.port) as sock:
            for byte in post(xmlrpc.client.dumps(("/a",), "getUri").encode()):
                sock.sendall(bytes([byte]))
            return _answer(sock)

    assert episode.graph.uri.encode() in episode.during(dribble)[1]


def test_a_client_that_asks_first_is_told_to_go_on(episode: Episode):
    body = xmlrpc.client.dumps(("/a",), "getUri").encode()
    with connected(episode.port) as sock:
        head = post(b"", length=len(body))[:-2] + b"Expect: 100-continue\r\nConnection: close\r\n\r\n"
        episode.during(sock.sendall, head)
        assert episode.during(sock.recv, 65536).startswith(b"HTTP/1.1 100 ")
        episode.during(sock.sendall, body)
        assert episode.graph.uri.encode() in episode.during(_answer, sock)[1]
        assert episode.during(sock.recv, 1) == b""


def test_calls_sent_without_waiting_are_answered_in_their_order(episode: Episode):
    with PlayedNode() as node, connected(episode.port) as sock:
        # The first answer is held until the robot is connected.
        first = xmlrpc.client.dumps(("/node", "/cmd_vel", "geometry_msgs/Twist", node.uri), "registerPublisher")
        calls = [first, xmlrpc.client.dumps(("/node", "/a", 1), "setParam")]
        calls += [xmlrpc.client.dumps(("/node", "/a"), "getParam")]
        episode.during(sock.sendall, b"".join(post(each.encode()) for each in calls))
        data = b""
        while data.count(b"</methodResponse>") < 3:
            data += episode.during(sock.recv, 65536)
        assert b"publishes /cmd_vel" in data.split(b"</methodResponse>")[0]
        assert b"parameter /a set" in data.split(b"</methodResponse>")[1]


def test_a_multicall_of_too_many_calls_is_refused(episode: Episode):
    calls = [{"methodName": "getPid", "params": ["/a"]}] * (graph_limits.CALLS + 1)
    with pytest.raises(xmlrpc.client.Fault, match="at most 1000 calls"):
        episode.during(getattr(episode.master, "system.multicall"), calls)


@pytest.mark.parametrize("calls", [[1], [{"methodName": 3}], [{"methodName": "system.multicall", "params": []}], 7])
def test_a_multicall_that_is_none_is_refused(episode: Episode, calls: object):
    with pytest.raises(xmlrpc.client.Fault, match=r"system\.multicall"):
        episode.during(getattr(episode.master, "system.multicall"), calls)


def test_a_header_that_is_none_is_answered_with_the_reason(episode: Episode):
    with connected(episode.topic_port()) as sock:
        episode.during(sock.sendall, b"GET / HTTP/1.1\r\n\r\n")
        assert "a header of 542393671 bytes" in episode.during(read_header, sock)["error"]


def test_a_node_that_answers_nothing_is_not_waited_for(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "CALL_S", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        uri = f"http://127.0.0.1:{silent.getsockname()[1]}/"
        assert episode.call("registerPublisher", "/cmd_vel", "geometry_msgs/Twist", uri)[0] == 1
        assert "no answer" in episode.graph.unconnected()[0]
        assert episode.graph.busy == 0


def test_a_publishers_answer_is_not_held_for_ever(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "HOLD_S", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        uri = f"http://127.0.0.1:{silent.getsockname()[1]}/"
        assert episode.call("registerPublisher", "/cmd_vel", "geometry_msgs/Twist", uri)[0] == 1
        assert episode.graph.busy > 0


@pytest.mark.parametrize(
    "answer",
    [
        b"nonsense\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: 99999999999\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nContent-Length: 3\r\n\r\nabc",
        b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n",
    ],
)
def test_a_node_that_answers_garbage_is_not_connected(episode: Episode, answer: bytes):
    with socket.create_server(("127.0.0.1", 0)) as server:

        def reply() -> None:
            sock, _ = server.accept()
            with sock:
                sock.recv(65536)
                sock.sendall(answer)

        uri = f"http://127.0.0.1:{server.getsockname()[1]}/"
        body = xmlrpc.client.dumps(("/node", "/cmd_vel", "geometry_msgs/Twist", uri), "registerPublisher").encode()
        with connected(episode.port) as sock:
            sock.sendall(post(body))
            episode.during(reply)
            assert b"publishes /cmd_vel" in episode.during(_answer, sock)[1]
        assert len(episode.graph.unconnected()) == 1


def test_a_node_that_names_no_port_for_its_topic_is_not_connected(episode: Episode):
    with PlayedNode() as node:
        node._server.register_function(lambda *_: [1, "", ["UDPROS", "h", 7]], "requestTopic")
        assert episode.call("registerPublisher", "/cmd_vel", "geometry_msgs/Twist", node.uri)[0] == 1
        assert "it offers ['UDPROS', 'h', 7] for TCPROS" in episode.graph.unconnected()[0]


def test_the_graph_ends_while_nodes_wait_for_it(episode: Episode):
    with PlayedNode() as node, connected(episode.port) as sock:
        body = xmlrpc.client.dumps(("/node", "/cmd_vel", "geometry_msgs/Twist", node.uri), "registerPublisher").encode()
        sock.sendall(post(body) + b"POST")
        episode.graph.close()
        episode.graph.close()


def test_a_multicall_whose_answer_would_be_too_big_is_refused(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "BODY_BYTES", 100_000)
    monkeypatch.setattr(graph_limits, "PARAMETER_BYTES", 100_000)
    episode.call("setParam", "/a", "a" * 50_000)
    calls = [{"methodName": "getParam", "params": ["/a", "/a"]}] * 10
    with pytest.raises(xmlrpc.client.Fault, match="more bytes than all parameters have"):
        episode.during(getattr(episode.master, "system.multicall"), calls)


def test_calls_whose_answers_nobody_reads_are_not_answered(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "REQUEST_S", 3600.0)
    episode.call("setParam", "/a", "a" * 7_000_000)
    call = post(xmlrpc.client.dumps(("/node", "/a"), "getParam").encode())
    with connected(episode.port) as sock:
        episode.during(sock.sendall, call * 50)
        episode.serve_until(lambda: episode.graph.busy == 1)
        assert episode.graph._events._buffered < 15_000_000
        episode.pass_time(3600.0)
        episode.serve_until(lambda: episode.graph.busy == 0)
    assert not episode.graph.failure


def test_connections_that_hold_too_much_together_fail_the_episode(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "BUFFERED_BYTES", 2_000_000)
    half = post(b"a" * 900_000, length=1_000_000)
    socks = [socket.create_connection(("127.0.0.1", episode.port)) for _ in range(4)]

    def send(sock: socket.socket) -> None:
        with suppress(ConnectionError):
            sock.sendall(half)

    for each in socks:
        episode.during(send, each)
    episode.serve_until(lambda: bool(episode.graph.failure))
    assert "2000000 are kept" in episode.graph.failure
    assert episode.call("getUri")[0] == 1
    for each in socks:
        each.close()
    episode.serve_until(lambda: episode.graph._events._buffered == 0)


def test_updates_that_wait_for_nodes_are_bounded_in_bytes(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "BUFFERED_BYTES", 1_000_000)
    monkeypatch.setattr(graph_limits, "CALL_S", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        episode.call("subscribeParam", f"http://127.0.0.1:{silent.getsockname()[1]}/", "/a")
        for _ in range(20):
            episode.graph.set_parameter("/a", "a" * 100_000)
        assert episode.graph._events._buffered <= 1_000_000
        episode.serve_until(lambda: not episode.graph.busy)
        assert episode.graph._events._buffered == 0


def test_nodes_are_bounded(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "NODES", 3)
    uri = "http://127.0.0.1:1/"
    answers = [episode.call("registerSubscriber", "/a", "a/B", uri, caller=f"/node{number}") for number in range(5)]
    assert [each[0] for each in answers] == [1, 1, 1, -1, -1]


def test_more_connections_than_there_may_be_fail_the_episode(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "CONNECTIONS", 5)
    socks = [socket.create_connection(("127.0.0.1", episode.port)) for _ in range(10)]
    episode.serve_until(lambda: bool(episode.graph.failure))
    assert "more than 5 connections" in episode.graph.failure
    for each in socks:
        each.close()


def test_registrations_are_bounded(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "REGISTRATIONS", 30)
    uri = "http://127.0.0.1:1/"
    answers = [episode.call("registerPublisher", f"/t{number}", "a/B", uri)[0] for number in range(40)]
    assert answers[0] == 1
    assert answers[-1] == -1
    assert episode.call("unregisterPublisher", "/t0", uri)[2] == 1
    assert episode.call("registerPublisher", "/more", "a/B", uri)[0] == 1


def test_calls_that_wait_for_one_node_are_bounded(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "CALLS", 3)
    monkeypatch.setattr(graph_limits, "CALL_S", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        episode.call("subscribeParam", f"http://127.0.0.1:{silent.getsockname()[1]}/", "/a")
        for number in range(20):
            episode.graph.set_parameter("/a", number)
        assert episode.graph.busy <= 4
        episode.serve_until(lambda: not episode.graph.busy)
