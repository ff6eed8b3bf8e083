"""Turns of the event loop when they are asked for, naps that end when something comes, commands that come too late."""

import socket
import time
from collections.abc import Iterator

import pytest

from tasks.ros.graph.graph import Graph
from tasks.ros.graph.topic import CommandSource
from tasks.ros.lockstep.idle_detector import IdleDetector
from tasks.ros.lockstep.ros_lane import EventPump, RosLane
from tasks.ros.process.network import EpisodeNetwork


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


def test_an_answer_that_is_held_is_given_when_it_is_due_though_nothing_comes(pump: EventPump) -> None:
    done: list[int] = []
    pump.loop.call_later(0.01, done.append, 1)
    pump.serve()
    assert done == []
    while not done:
        pump.serve()
        time.sleep(0.001)


@pytest.mark.parametrize("stray", [True, False])
def test_a_node_that_begins_to_publish_commands_while_its_lane_was_quiet_is_stray(
    detector: IdleDetector, pump: EventPump, pair: tuple[socket.socket, socket.socket], *, stray: bool
) -> None:
    lane = RosLane(detector, EpisodeNetwork(socket.socket, ()), pump, frozenset())
    pair[0].settimeout(0.0)
    assert isinstance(detector.graph, Graph)
    detector.graph._subscriptions.incoming.append(CommandSource("/cmd_vel", "/node", pair[0], bytearray()))
    lane.collect(0, stray=stray)
    lane.collect(0, stray=True)
    assert (lane.commands, lane.stray) == (0, int(stray))
