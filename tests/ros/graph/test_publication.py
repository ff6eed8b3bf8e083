"""The robot's topics over TCPROS: headers, latched messages, subscribers that do not read."""

import socket

import pytest

from tasks.ros.graph import graph_limits
from tasks.ros.message.definition import definition, digest
from tests.ros.graph.episode import Episode, read_message


def test_a_subscriber_gets_what_is_published_after_its_header(episode: Episode):
    assert not episode.graph.publish("/scan", b"nobody")
    sock, answer = episode.subscribe(md5sum=digest("sensor_msgs/LaserScan"))
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
