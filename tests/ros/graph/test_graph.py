"""RoboMaker's services over TCPROS: tags and the end of a job."""

import socket
import struct

import pytest

from tasks.ros.graph import graph_limits as limits
from tasks.ros.graph.topic import ROBOT
from tasks.ros.message.definition import type_digest
from tasks.ros.message.ros_messages import frame_message, text_bytes, write_tags
from tests.ros.graph.episode import Episode, PlayedNode, read_exactly, read_message

ADD, CANCEL = "/robomaker/job/add_tags", "/robomaker/job/cancel"


def _open(episode: Episode, service: str, **more: str) -> tuple[socket.socket, dict[str, str]]:
    uri = episode.call("lookupService", service)[2]
    assert uri == f"rosrpc://127.0.0.1:{episode.topic_port()}"
    return episode.connect({"callerid": "/node", "service": service, "md5sum": "*"} | more)


def _ask(episode: Episode, service: str, request: bytes) -> tuple[int, bytes]:
    sock, _ = _open(episode, service)
    with sock:
        episode.during(sock.sendall, frame_message(request))
        good = episode.during(read_exactly, sock, 1)[0]
        answer = episode.during(read_message, sock)
        assert episode.during(sock.recv, 1) == b""
        return good, answer


def test_tags_are_added_listed_and_removed(episode: Episode):
    assert _ask(episode, ADD, write_tags({"kind": "patrol", "site": "north"})) == (1, b"\1" + text_bytes(""))
    assert episode.graph.tags == {"kind": "patrol", "site": "north"}
    _ask(episode, "/robomaker/job/remove_tags", struct.pack("<I", 1) + text_bytes("kind"))
    assert _ask(episode, "/robomaker/job/list_tags", b"") == (1, b"\1" + text_bytes("") + write_tags({"site": "north"}))


@pytest.mark.parametrize(
    ("tags", "fault"),
    [
        ({"": "x"}, "at least 1 character"),
        ({"aws:x": "x"}, "aws"),
        ({str(number): "" for number in range(51)}, "at most 50"),
    ],
)
def test_tags_that_robomaker_does_not_take_are_refused_with_the_reason(
    episode: Episode, tags: dict[str, str], fault: str
):
    good, answer = _ask(episode, ADD, write_tags(tags))
    assert (good, answer[0]) == (1, 0)
    assert fault in answer[5:].decode()
    assert episode.graph.tags == {}


def test_a_job_is_cancelled_once_the_application_says_so(episode: Episode):
    assert not episode.graph.cancelled
    assert _ask(episode, CANCEL, b"") == (1, b"\1" + text_bytes(""))
    assert episode.graph.cancelled


def test_a_request_that_is_none_is_answered_with_the_reason(episode: Episode):
    good, answer = _ask(episode, ADD, b"\xff\xff\xff\xff")
    assert good == 0
    assert b"a list of 4294967295 that ends after 0" in answer


def test_a_persistent_connection_takes_one_request_after_the_other(episode: Episode):
    sock, answer = _open(episode, ADD, persistent="1")
    with sock:
        assert answer["md5sum"] == type_digest("robomaker_simulation_msgs/AddTags")
        assert answer["request_type"] == "robomaker_simulation_msgs/AddTagsRequest"
        for key in ("a", "b"):
            episode.during(sock.sendall, frame_message(write_tags({key: key})))
            assert episode.during(read_exactly, sock, 1) == b"\1"
            episode.during(read_message, sock)
    assert episode.graph.tags == {"a": "a", "b": "b"}


def _links(episode: Episode, most: int) -> int:
    """Returns how often nodes are asked until all are linked; as often at most."""
    for asked in range(most):
        if episode.graph.linked():
            return asked
        episode.serve_until(lambda: not episode.graph.busy)
    return most


def test_a_subscriber_is_asked_until_it_has_connected_to_each_publisher(episode: Episode):
    """As roscpp: it hears of the publisher at once, and connects when it looks next for what it has to do."""
    with PlayedNode() as node:
        link = [1, "http://127.0.0.1:1/", "i", "TCPROS", "/map2", True]
        node.links = [[], [[2, "/other", "o", "TCPROS", "/map2", True]], [link]]
        episode.call("registerPublisher", "/map2", "x/Map", "http://127.0.0.1:1/", caller="/server")
        episode.call("registerSubscriber", "/map2", "x/Map", node.uri)
        assert _links(episode, 9) == 3
        assert episode.graph.linked()
        node.links = [[], [link]]
        episode.call("registerSubscriber", "/map2", "x/Map", node.uri)
        assert _links(episode, 9) == 2


def test_a_subscriber_that_does_not_connect_is_given_up_once(episode: Episode):
    with PlayedNode() as node:
        episode.call("registerPublisher", "/map2", "x/Map", "http://127.0.0.1:1/", caller="/server")
        episode.call("registerSubscriber", "/map2", "y/Map", node.uri)
        assert _links(episode, 3) == 3
        episode.graph.give_links_up()
        assert episode.graph.linked()
        episode.call("registerSubscriber", "/other", "y/Map", node.uri)
        assert _links(episode, 3) == 0


def test_a_subscriber_of_the_robot_is_linked_once_it_has_connected(episode: Episode):
    episode.call("registerSubscriber", "/scan", "sensor_msgs/LaserScan", "http://127.0.0.1:1/")
    assert not episode.graph.linked()
    sock, _ = episode.subscribe()
    with sock:
        assert episode.graph.linked()


def test_who_asks_for_a_service_under_many_names_fills_no_memory(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(limits, "CALLS", 2)
    for number in range(4):
        episode.call("lookupService", ADD, caller=f"/node{number}")
    assert episode.graph.take_asked() == {("/node0", ROBOT), ("/node1", ROBOT)}
    assert episode.graph.take_asked() == set()


def test_a_probe_gets_the_header_alone(episode: Episode):
    sock, answer = _open(episode, CANCEL, probe="1")
    with sock:
        assert answer["type"] == "robomaker_simulation_msgs/Cancel"
        assert episode.during(sock.recv, 1) == b""


@pytest.mark.parametrize(
    ("service", "md5sum", "fault"),
    [("/none", "*", "has no service '/none'"), (ADD, "1", "is robomaker_simulation_msgs/AddTags with md5sum 6377")],
)
def test_a_header_that_does_not_fit_is_refused(episode: Episode, service: str, md5sum: str, fault: str):
    sock, answer = episode.connect({"callerid": "/node", "service": service, "md5sum": md5sum})
    with sock:
        assert fault in answer["error"]


def test_a_request_of_gigabytes_is_refused_at_once(episode: Episode):
    sock, _ = _open(episode, ADD)
    with sock:
        episode.during(sock.sendall, struct.pack("<I", 2**32 - 1))
        assert episode.during(read_exactly, sock, 1) == b"\0"
        assert b"a request of 4294967295 bytes" in episode.during(read_message, sock)
