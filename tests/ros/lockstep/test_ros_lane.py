"""Turns of the event loop when they are asked for, and naps that end when something comes."""

import socket
from collections.abc import Iterator

import pytest

from tasks.ros.lockstep.ros_lane import EventPump


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    ours, theirs = socket.socketpair()
    yield ours, theirs
    ours.close()
    theirs.close()


def test_what_has_come_is_served_and_what_it_brings_about_as_well(
    pump: EventPump, pair: tuple[socket.socket, socket.socket]
) -> None:
    heard: list[bytes] = []
    pump.loop.add_reader(pair[0], lambda: heard.append(pair[0].recv(1)))
    pair[1].send(b"abc")
    pump.serve()
    assert heard == [b"a", b"b", b"c"]
    pump.loop.remove_reader(pair[0])


def test_nothing_happens_before_it_is_asked_for(pump: EventPump) -> None:
    done: list[int] = []
    pump.loop.call_soon(done.append, 1)
    assert done == []
    pump.turn()
    assert done == [1]


def test_a_command_ends_a_nap_and_the_end_of_the_time_does(
    pump: EventPump, pair: tuple[socket.socket, socket.socket]
) -> None:
    pump.watch(pair[0])
    pump.watch(pair[0])
    assert not pump.nap(0.001)
    pair[1].send(b"x")
    assert pump.nap(200.0)
