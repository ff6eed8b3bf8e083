"""Datagrams that are dropped, as the kernel counts them."""

import os
import socket
from collections.abc import Iterator

import pytest

from tasks.ros.ros2.datagrams import DropWatch, UdpSocket
from tasks.ros.ros2.dds_domain import EpisodeDomain, domain_of
from tasks.ros.ros2.robot_links import RobotLinks
from tasks.ros.ros2.ros2_node import RobotInterface


@pytest.fixture
def full() -> Iterator[socket.socket]:
    """A socket without room."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        made.bind(("127.0.0.1", 0))
        yield made


def test_a_socket_whose_room_is_full_is_told_once_with_how_many_it_lost(full: socket.socket) -> None:
    inode, (_, port), watch = os.fstat(full.fileno()).st_ino, full.getsockname(), DropWatch()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for _ in range(50):
            sender.sendto(bytes(1000), full.getsockname())
    full.settimeout(0.0)
    kept = 0
    while True:
        try:
            kept += bool(full.recv(1000))
        except BlockingIOError:
            break
    assert 0 < kept < 50
    assert watch.look().get(inode) == UdpSocket(port, 50 - kept)
    assert inode not in watch.look()


@pytest.mark.parametrize(
    ("port", "domain"),
    [(7399, None), (7400, 0), (7411, 0), (7530, 0), (7532, None), (7650, 1), (32650, 101), (32900, None)],
)
def test_a_port_is_the_domains_whose_participants_may_have_it(port: int, domain: int | None) -> None:
    assert domain_of(port) == domain


def test_of_dropped_datagrams_those_to_an_episodes_nodes_are_its_own(domain: EpisodeDomain) -> None:
    robot, first = RobotLinks(domain, RobotInterface({}, "/cmd_vel")), 7400 + 250 * domain.number
    other = 7400 + 250 * (domain.number + 1) if domain.number < 101 else 7400
    lost = {
        1: UdpSocket(first + 11, 2),
        2: UdpSocket(first + 20, 3),
        3: UdpSocket(other + 11, 5),
        4: UdpSocket(60000, 7),
    }
    assert robot.dropped(lost) == 5
    robot.close()
