"""Datagrams that the kernel dropped, for want of room before their reader took them.

What is reliable is sent again; what is best effort is lost, and nobody is told.

Sources: Linux, net/ipv4/udp.c, for the columns of ``/proc/net/udp``.
"""

from pathlib import Path
from typing import NamedTuple

_SOCKETS = Path("/proc/self/net/udp")
_LOCAL, _INODE = 1, 9


class UdpSocket(NamedTuple):
    """A socket of UDP of this network, whoever has it.

    Attributes:
        port: Its own.
        dropped: Datagrams so far.
    """

    port: int
    dropped: int


def udp_sockets() -> dict[int, UdpSocket]:
    """Returns all sockets of UDP in this network by their inodes."""
    lines = (line.split() for line in _SOCKETS.read_text().splitlines()[1:])
    return {int(each[_INODE]): UdpSocket(int(each[_LOCAL].rpartition(":")[2], 16), int(each[-1])) for each in lines}


class DropWatch:
    """Sees which sockets drop datagrams; what they dropped before it was made is passed over."""

    def __init__(self) -> None:
        self._before = udp_sockets()

    def look(self) -> dict[int, UdpSocket]:
        """Returns the sockets that have dropped datagrams since the last call, and how many, by inode."""
        before, self._before = self._before, udp_sockets()
        more = {inode: each.dropped - before.get(inode, _NEW).dropped for inode, each in self._before.items()}
        return {inode: UdpSocket(self._before[inode].port, count) for inode, count in more.items() if count > 0}


_NEW = UdpSocket(0, 0)
