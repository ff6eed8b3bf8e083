"""What a graph keeps for its nodes is bounded, in numbers and in bytes."""

import socket
import xmlrpc.client
from contextlib import suppress

import pytest

from tasks.ros.graph import graph_limits
from tests.ros.graph.episode import Episode
from tests.ros.graph.test_attacks import connected, post


def test_a_multicall_whose_answer_would_be_too_big_is_refused(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "BODY_BYTES", 100_000)
    monkeypatch.setattr(graph_limits, "PARAMETER_BYTES", 100_000)
    episode.call("setParam", "/a", "a" * 50_000)
    calls = [{"methodName": "getParam", "params": ["/a", "/a"]}] * 10
    with pytest.raises(xmlrpc.client.Fault, match="more bytes than all parameters have"):
        episode.during(getattr(episode.master, "system.multicall"), calls)


def test_calls_whose_answers_nobody_reads_are_not_answered(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "REQUEST_S", 0.05)
    episode.call("setParam", "/a", "a" * 7_000_000)
    call = post(xmlrpc.client.dumps(("/node", "/a"), "getParam").encode())
    with connected(episode.port) as sock:
        episode.during(sock.sendall, call * 50)
        episode.serve_until(lambda: episode.graph.busy == 1)
        assert episode.graph._events._buffered < 15_000_000
        episode.serve_until(lambda: episode.graph.busy == 0)
    assert not episode.graph.failure


def test_connections_that_hold_too_much_together_fail_the_episode(episode: Episode, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "BUFFERED_BYTES", 2_000_000)
    half = post(b"a" * 900_000, length=1_000_000)
    socks = [socket.create_connection(("127.0.0.1", episode.port), 20.0) for _ in range(4)]

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
    socks = [socket.create_connection(("127.0.0.1", episode.port), 20.0) for _ in range(10)]
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
