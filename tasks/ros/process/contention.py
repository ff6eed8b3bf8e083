"""Who was told something over TCP, and by whom: a node that two others told something had it in nobody's order.

Lock-step sends one message to one process. What its nodes then say to each other goes from one to the next, and has one
order, until two of them speak to a third one: which is heard first is the machine's affair. The kernel counts the bytes
of each connection, so that this is seen, and nothing that the nodes do is changed by it.

Sources: sock_diag(7); Linux, include/uapi/linux/tcp.h; ROS's "TCPROS": who listens is told first.
"""

import contextlib
import os
import socket
import struct
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from tasks.ros.process.application_processes import ApplicationProcesses
from tasks.ros.process.lane_limits import NO_ROOM
from tasks.ros.process.network import EpisodeNetwork, new_diag

# Two that speak, and one that hears them.
_FEWEST = 3
_ANSWER_BYTES = 1 << 18
_HEAD, _DUMP, _BY_FAMILY, _DONE, _ERROR = struct.Struct("=IHHII"), 0x301, 20, 3, 2
_QUESTION = struct.Struct("=BBBBI48x")
_LISTENS, _STATES, _INFO, _WANTED = 10, sum(1 << state for state in (1, 4, 5, 8, 10)), 2, 1 << 1
# Within an answer: its state, its ports, its inode; within what it says of TCP: bytes that came, and that were sent.
_STATE_AT, _PORTS, _PORTS_AT, _INODE_AT, _ATTRIBUTES_AT = 17, struct.Struct(">HH"), 20, 84, 88
_COUNTS, _COUNTS_AT = struct.Struct("=Q64xQ"), 128


class _Connection(NamedTuple):
    """One end of a connection.

    Attributes:
        inode: Of its socket.
        came, sent: Bytes so far.
        asked: Whether this end listened.
    """

    inode: int
    came: int
    sent: int
    asked: bool


class ConnectionWatch:
    """The connections of one application.

    Args:
        application: Its processes.
        network: Its own.
        asked: Returns who asked for which node's service since the last call.
    """

    def __init__(
        self, application: ApplicationProcesses, network: EpisodeNetwork, asked: Callable[[], set[tuple[str, str]]]
    ) -> None:
        self._application, self._network, self._asked = application, network, asked
        self._before: dict[tuple[int, int], _Connection] = {}
        self._owners: dict[int, int] = {}

    def contended(self) -> bool:
        """Returns whether two processes told a third one something since the last call."""
        callers = self._asked()
        if len(self._application.processes()) < _FEWEST:
            self._before = {}
            return False
        before, now = self._before, _connections(self._network.diag)
        self._before = now
        moved = [
            (each.inode, now[theirs, ours].inode)
            for (ours, theirs), each in now.items()
            if (theirs, ours) in now and (ours, theirs) in before and _heard(before[ours, theirs], each)
        ]
        self._find_owners({inode for ends in moved for inode in ends}, now)
        told = defaultdict[int | str, set[int | str]](set)
        for ends in moved:
            reader, writer = (self._owners[inode] for inode in ends)
            if reader and writer and reader != writer:
                told[reader].add(writer)
        if callers:
            known = {self._application.node_of(pid): pid for pid in self._application.processes()}
            for caller, provider in callers:
                told[known.get(provider, provider)].add(known.get(caller, caller))
        return any(len(writers) > 1 for writers in told.values())

    def _find_owners(self, inodes: set[int], now: Mapping[tuple[int, int], _Connection]) -> None:
        """Notes which process has each socket, where one is new: 0 for one that is not the application's."""
        if not inodes <= self._owners.keys():
            found = {inode: pid for pid in self._application.processes() for inode in _sockets(pid)}
            self._owners = {each.inode: found.get(each.inode, 0) for each in now.values()}


def counts_bytes() -> bool:
    """Returns whether this kernel tells of connections; without that nobody sees that nodes race.

    Raises:
        OSError: There is no room for another open file.
    """
    try:
        with new_diag() as diag:
            _connections(diag)
    except OSError as exc:
        if exc.errno in NO_ROOM:
            raise
        return False
    return True


def _heard(before: _Connection, now: _Connection) -> bool:
    """Returns whether one end was told something, other than the answer to what it asked."""
    return now.inode == before.inode and now.came > before.came and (now.asked or now.sent == before.sent)


def _sockets(pid: int) -> Iterator[int]:
    """Yields the inodes of a process's sockets; of one that has ended, none."""
    with contextlib.suppress(OSError), os.scandir(f"/proc/{pid}/fd") as found:
        for each in found:
            with contextlib.suppress(OSError):
                kind, _, inode = os.readlink(each.path).partition(":[")  # noqa: PTH115 - no path, and many
                if kind == "socket":
                    yield int(inode[:-1])


def _connections(diag: socket.socket) -> dict[tuple[int, int], _Connection]:
    """Returns all ends of connections by ports, their own first."""
    question = _QUESTION.pack(socket.AF_INET, socket.IPPROTO_TCP, _WANTED, 0, _STATES)
    diag.send(_HEAD.pack(_HEAD.size + len(question), _BY_FAMILY, _DUMP, 1, 0) + question)
    listening, found = set[int](), list[tuple[tuple[int, int], tuple[int, int, int]]]()
    for answer in _answers(diag):
        ports = _PORTS.unpack_from(answer, _PORTS_AT)
        if answer[_STATE_AT] == _LISTENS:
            listening.add(ports[0])
        else:
            (inode,) = struct.unpack_from("=I", answer, _INODE_AT)
            found.append((ports, (inode, *_counts(answer))))
    return {ports: _Connection(*each, asked=ports[0] in listening) for ports, each in found}


def _answers(diag: socket.socket) -> Iterator[memoryview]:
    """Yields the kernel's answers, each about a socket.

    Raises:
        OSError: It has none.
    """
    while True:
        data, at = memoryview(diag.recv(_ANSWER_BYTES)), 0
        while at < len(data):
            length, kind = _HEAD.unpack_from(data, at)[:2]
            if kind == _DONE:
                return
            if kind == _ERROR:
                number = -struct.unpack_from("=i", data, at + _HEAD.size)[0]
                raise OSError(number, f"the kernel does not tell of connections (sock_diag): {os.strerror(number)}")
            yield data[at : at + length]
            at += length + -length % 4


def _counts(answer: memoryview) -> tuple[int, int]:
    """Returns how many bytes came, and how many were sent."""
    at = _ATTRIBUTES_AT
    while at < len(answer):
        length, kind = struct.unpack_from("=HH", answer, at)
        if kind == _INFO:
            came, sent = _COUNTS.unpack_from(answer, at + 4 + _COUNTS_AT)
            return came, sent
        at += length + -length % 4
    return 0, 0
