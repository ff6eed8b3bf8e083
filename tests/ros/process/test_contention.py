"""Two processes that tell a third one something within one message: which came first, nobody fixes."""

import errno
import os
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from tasks.ros.process import contention
from tasks.ros.process.application_processes import ApplicationProcesses, ProcessTracker
from tasks.ros.process.contention import ConnectionWatch, counts_bytes
from tasks.ros.process.lane_limits import LaneLimits
from tasks.ros.process.network import EpisodeNetworks


class Talk(NamedTuple):
    """Who calls and who listens: each end as a socket of a process of its own, the listener's number 1."""

    callers: list[socket.socket]
    listener: list[socket.socket]
    watch: ConnectionWatch
    asked: set[tuple[str, str]]

    def says(self, writer: socket.socket, reader: socket.socket) -> None:
        writer.sendall(b"something")
        assert reader.recv(100) == b"something"


@pytest.fixture
def talk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Talk]:
    """Processes 2 and 3, each connected to process 1."""
    tracker = ProcessTracker()
    application = ApplicationProcesses(tmp_path, tracker, LaneLimits())
    monkeypatch.setattr(application, "processes", lambda: [1, 2, 3])
    with EpisodeNetworks(tmp_path / "home") as networks:
        network = networks.new()
        server = network.new_socket()
        server.bind(("127.0.0.1", 0))
        server.listen()
        callers = [network.new_socket() for _ in range(2)]
        for each in callers:
            each.connect(server.getsockname())
        listener = [server.accept()[0] for _ in callers]
        ends = {1: listener, 2: callers[:1], 3: callers[1:]}
        monkeypatch.setattr(contention, "_sockets", lambda pid: [os.fstat(each.fileno()).st_ino for each in ends[pid]])
        asked = set[tuple[str, str]]()
        watch = ConnectionWatch(application, network, lambda: asked)
        assert not watch.contended(), "what came before it was asked first is not counted"
        yield Talk(callers, listener, watch, asked)
        for each in (server, *callers, *listener):
            each.close()
        network.close()
    application.watch.close()
    tracker.close()


def ask(talk: Talk, callers: int) -> None:
    for ours, theirs in [*zip(talk.callers, talk.listener, strict=True)][:callers]:
        talk.says(ours, theirs)
        talk.says(theirs, ours)


def tell_both(talk: Talk) -> None:
    for ours, theirs in zip(talk.listener, talk.callers, strict=True):
        talk.says(ours, theirs)


CASES: dict[str, tuple[Callable[[Talk], None], bool]] = {
    "nobody": (lambda _: None, False),
    "one-asks": (lambda talk: ask(talk, 1), False),
    "both-are-told": (tell_both, False),
    "both-ask": (lambda talk: ask(talk, 2), True),
    "both-look-for-its-service": (lambda talk: talk.asked.update({("/a", "/c"), ("/b", "/c")}), True),
    "one-looks-for-its-service": (lambda talk: talk.asked.update({("/a", "/c"), ("/a", "/d")}), False),
}


@pytest.mark.parametrize("case", CASES)
def test_only_two_that_tell_one_are_counted(talk: Talk, case: str) -> None:
    does, counts = CASES[case]
    does(talk)
    assert talk.watch.contended() is counts
    talk.asked.clear()
    assert not talk.watch.contended(), "nothing is counted twice"


def test_one_that_listens_to_two_is_counted(talk: Talk, monkeypatch: pytest.MonkeyPatch) -> None:
    ends = {1: talk.callers, 2: talk.listener[:1], 3: talk.listener[1:]}
    monkeypatch.setattr(contention, "_sockets", lambda pid: [os.fstat(each.fileno()).st_ino for each in ends[pid]])
    talk.watch._owners.clear()
    tell_both(talk)
    assert talk.watch.contended()


def test_handles_of_processes_are_read_for_new_connections_alone(talk: Talk, monkeypatch: pytest.MonkeyPatch) -> None:
    """The callers are the robot's, whose sockets no process of the application has."""
    read: list[int] = []

    def sockets(pid: int) -> list[int]:
        read.append(pid)
        return [os.fstat(each.fileno()).st_ino for each in talk.listener] if pid == 1 else []

    monkeypatch.setattr(contention, "_sockets", sockets)
    for caller in (0, 1, 0, 1):
        talk.says(talk.callers[caller], talk.listener[caller])
        assert not talk.watch.contended()
    assert read == [1, 2, 3]


def test_what_was_said_while_there_were_two_processes_is_not_counted_when_a_third_one_comes(
    talk: Talk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(talk.watch._application, "processes", lambda: [1, 2])
    assert not talk.watch.contended()
    ask(talk, 2)
    monkeypatch.setattr(talk.watch._application, "processes", lambda: [1, 2, 3])
    assert not talk.watch.contended()


@pytest.mark.parametrize("refused", [errno.ENOENT, errno.EPROTONOSUPPORT])
def test_a_kernel_that_does_not_tell_of_connections_is_known(monkeypatch: pytest.MonkeyPatch, refused: int) -> None:
    assert counts_bytes()

    def connections(_: socket.socket) -> None:
        raise OSError(refused, "no sock_diag")

    monkeypatch.setattr(contention, "_connections", connections)
    assert not counts_bytes()
    refused = errno.EMFILE
    with pytest.raises(OSError, match="no sock_diag"):
        counts_bytes()
