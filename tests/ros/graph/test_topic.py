"""What the robot publishes reaches whoever subscribes, and what nodes command reaches the robot."""

import socket
import struct

import pytest

from tasks.ros.graph import graph_limits
from tasks.ros.graph.gazebo_services import SET_MODEL_STATE, SET_MODEL_STATE_KIND, GazeboServices
from tasks.ros.message.definition import definition, type_digest
from tasks.ros.message.ros_messages import PlanarTwist, frame_message, twist
from tests.ros.graph.episode import Episode, PlayedNode, read_message


def test_a_subscriber_gets_what_is_published_after_its_header(episode: Episode):
    assert not episode.graph.publish("/scan", b"nobody")
    sock, answer = episode.subscribe(md5sum=type_digest("sensor_msgs/LaserScan"))
    assert answer["type"] == "sensor_msgs/LaserScan"
    assert answer["message_definition"] == definition("sensor_msgs/LaserScan")
    assert answer["latching"] == "0"
    assert episode.graph.publish("/scan", b"one")
    assert episode.graph.publish("/scan", b"two")
    assert (episode.during(read_message, sock), episode.during(read_message, sock)) == (b"one", b"two")
    sock.close()
    episode.serve_until(lambda: not episode.graph.outgoing["/scan"])


def test_who_subscribes_late_gets_the_last_latched_message(episode: Episode):
    episode.graph.publish("/map", b"old")
    episode.graph.publish("/map", b"new")
    sock, answer = episode.subscribe("/map")
    with sock:
        assert answer["latching"] == "1"
        assert episode.during(read_message, sock) == b"new"


@pytest.mark.parametrize(
    ("topic", "md5sum", "fault"),
    [
        ("/none", "*", "does not publish '/none'"),
        ("/cmd_vel", "*", "does not publish '/cmd_vel'"),
        ("/scan", "0" * 32, "/scan has sensor_msgs/LaserScan with md5sum 90c7"),
    ],
)
def test_a_header_that_does_not_fit_is_answered_with_the_reason(episode: Episode, topic: str, md5sum: str, fault: str):
    sock, answer = episode.subscribe(topic, md5sum)
    with sock:
        assert fault in answer["error"]
        assert episode.during(sock.recv, 1) == b""


def test_a_subscriber_of_another_type_fails_the_episode(episode: Episode):
    sock, _ = episode.subscribe("/scan", "0" * 32)
    sock.close()
    assert episode.graph.failure.startswith("/node cannot subscribe: /scan has sensor_msgs/LaserScan")


def test_a_message_larger_than_the_kernels_buffers_arrives_whole(episode: Episode):
    sock, _ = episode.subscribe("/map")
    with sock:
        grid = bytes(range(256)) * 100_000
        episode.graph.publish("/map", grid)
        assert episode.graph.busy == 1
        assert episode.during(read_message, sock) == grid
        episode.serve_until(lambda: not episode.graph.busy)
        assert not episode.graph.failure


def test_a_subscriber_that_does_not_read_fails_the_episode(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "BACKLOG_BYTES", 1000)
    sock, _ = episode.subscribe()
    with sock:
        for _ in range(3):
            episode.graph.publish("/scan", bytes(10_000_000))
    assert "/node subscribed to /scan and does not read it" in episode.graph.failure
    assert episode.graph.outgoing["/scan"] == []
    assert episode.graph.busy == 0


def test_a_graph_is_connected_when_all_who_subscribed_are(episode: Episode):
    episode.call("registerSubscriber", "/scan", "sensor_msgs/LaserScan", "http://127.0.0.1:1/")
    assert episode.graph.unconnected() == ["/node subscribed to /scan, and has not connected"]
    sock, _ = episode.subscribe()
    with sock:
        assert episode.graph.connected()
        assert episode.call("getBusInfo")[2] == [[0, "/node", "o", "TCPROS", "/scan", True]]


def test_what_a_subscriber_says_is_dropped(episode: Episode):
    sock, _ = episode.subscribe()
    with sock:
        episode.during(sock.sendall, bytes(3_000_000))
        episode.graph.publish("/scan", b"one")
        assert episode.during(read_message, sock) == b"one"


def test_all_ports_are_closed_in_the_end():
    with Episode() as episode:
        ports = [episode.port, episode.topic_port()]
    for port in ports:
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", port), 1.0)


FORWARD, BACK = (twist(PlanarTwist(speed, 0.0, 0.0)) for speed in (1.0, -1.0))


def _register(episode: Episode, node: PlayedNode) -> None:
    answer = episode.call("registerPublisher", "/cmd_vel", node.kind, node.uri, caller=node.name)
    assert answer[0] == 1


def _commands(episode: Episode, count: int) -> list[bytes]:
    found: list[tuple[str, bytes]] = []

    def take() -> bool:
        found.extend(episode.graph.take())
        return len(found) >= count

    episode.serve_until(take)
    assert {topic for topic, _ in found} == {"/cmd_vel"}
    return [data for _, data in found]


def test_the_robot_is_connected_when_a_publisher_gets_its_answer(episode: Episode):
    with PlayedNode() as node:
        _register(episode, node)
        assert [each.node for each in episode.graph.incoming] == ["/node"]
        assert episode.graph.connected()
        node.connections[0].sendall(frame_message(FORWARD) + frame_message(BACK))
        assert _commands(episode, 2) == [FORWARD, BACK]
        assert episode.call("getBusInfo")[2] == [[0, "/node", "i", "TCPROS", "/cmd_vel", True]]


def test_a_command_that_comes_with_the_header_is_not_lost(episode: Episode):
    with PlayedNode(first=frame_message(FORWARD)) as node:
        _register(episode, node)
        assert _commands(episode, 1) == [FORWARD]


def test_commands_that_come_in_pieces_are_put_together(episode: Episode):
    with PlayedNode() as node:
        _register(episode, node)
        data = frame_message(FORWARD)
        node.connections[0].sendall(data[:3])
        assert episode.graph.take() == []
        node.connections[0].sendall(data[3:] + data[:10])
        assert _commands(episode, 1) == [FORWARD]
        node.connections[0].sendall(data[10:])
        assert _commands(episode, 1) == [FORWARD]


def test_of_two_nodes_the_one_whose_name_is_last_has_the_last_word(episode: Episode):
    with PlayedNode("/b") as late, PlayedNode("/a") as early:
        _register(episode, late)
        _register(episode, early)
        late.connections[0].sendall(frame_message(BACK))
        early.connections[0].sendall(frame_message(FORWARD))
        assert _commands(episode, 2) == [FORWARD, BACK]


def test_a_node_that_ends_is_forgotten_after_its_last_command(episode: Episode):
    with PlayedNode() as node:
        _register(episode, node)
        node.connections[0].sendall(frame_message(FORWARD))
        node.connections[0].close()
        assert _commands(episode, 1) == [FORWARD]
        episode.serve_until(lambda: not episode.graph.take() and not episode.graph.incoming)


def test_a_node_that_publishes_again_is_connected_again(episode: Episode):
    with PlayedNode() as node:
        _register(episode, node)
        episode.call("unregisterPublisher", "/cmd_vel", node.uri)
        _register(episode, node)
        assert len(node.connections) == 2


def test_a_publisher_of_another_type_fails_the_episode(episode: Episode):
    with PlayedNode(kind="sensor_msgs/Imu") as node:
        _register(episode, node)
        assert "cannot command the robot on /cmd_vel: the robot takes geometry_msgs/Twist" in episode.graph.failure
        assert "I have sensor_msgs/Imu" in episode.graph.unconnected()[0]
        assert not episode.graph.connected()


def test_a_publisher_that_nobody_reaches_gets_its_answer(episode: Episode):
    assert episode.call("registerPublisher", "/cmd_vel", "geometry_msgs/Twist", "http://127.0.0.1:1/")[0] == 1
    assert episode.graph.unconnected() == ["/node publishes /cmd_vel: port 1: no answer"]
    assert episode.graph.busy == 0


@pytest.mark.parametrize("length", [2**32 - 1, graph_limits.COMMAND_MESSAGE_BYTES + 1])
def test_a_message_that_would_be_too_long_fails_the_episode(episode: Episode, length: int):
    with PlayedNode() as node:
        _register(episode, node)
        node.connections[0].sendall(frame_message(FORWARD) + struct.pack("<I", length))
        assert _commands(episode, 1) == [FORWARD]
        episode.serve_until(lambda: not episode.graph.take() and bool(episode.graph.failure))
        assert episode.graph.failure.startswith(f"/node announces a message of {length} bytes on /cmd_vel")


def test_a_flood_of_commands_fails_the_episode(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "COMMAND_BYTES", 10_000)
    with PlayedNode() as node:
        _register(episode, node)
        episode.during(node.connections[0].sendall, frame_message(FORWARD) * 2000)
        episode.serve_until(lambda: bool(episode.graph.take() and episode.graph.failure))
        assert episode.graph.failure.startswith("/node floods /cmd_vel")


def test_more_publishers_than_there_may_be_fail_the_episode(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "PUBLISHERS", 1)
    with PlayedNode("/a") as one, PlayedNode("/b") as other:
        _register(episode, one)
        _register(episode, other)
        assert episode.graph.failure == "more than 1 nodes publish /cmd_vel"


def test_who_sets_the_robot_elsewhere_commands_nothing_and_what_is_no_state_fails_the_episode():
    with Episode(GazeboServices("rover", 0.005)) as episode, PlayedNode(kind=SET_MODEL_STATE_KIND) as node:
        episode.call("registerPublisher", SET_MODEL_STATE, node.kind, node.uri, caller=node.name)
        assert episode.graph.connected()
        assert episode.graph.incoming == []
        node.connections[0].sendall(frame_message(b"\x09\0\0\0rov"))
        episode.serve_until(lambda: not episode.graph.take() and bool(episode.graph.failure))
        assert episode.graph.failure == "/gazebo/set_model_state: a text of 9 bytes where 3 are left"
