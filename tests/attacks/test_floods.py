"""Endless bodies and heads: refused, and others are answered meanwhile."""

import select
import socket
from collections.abc import Iterator
from contextlib import ExitStack, suppress

import pytest

from tests.factories.gateway.served import NOBODY, Served, served

pytestmark = [pytest.mark.integration, pytest.mark.long]
HALF = b"POST /createFleet HTTP/1.1\r\nhost: a\r\ncontent-"
GIGABYTE = 1 << 30


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("flooded") / "s") as found:
        yield found


@pytest.fixture(scope="module")
def unsigned(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("unsigned") / "s", "--unsigned") as found:
        yield found


def connected(gateway: Served) -> socket.socket:
    return socket.create_connection(("127.0.0.1", gateway.port), 30)


def said(connection: socket.socket) -> bytes:
    found = b""
    try:
        while part := connection.recv(1 << 16):
            found += part
    except ConnectionError:
        pass
    return found


def said_so_far(connection: socket.socket) -> bytes:
    try:
        return connection.recv(1 << 16)
    except ConnectionError:
        return b""


def sent_until_refused(connection: socket.socket, part: bytes, most_bytes: int) -> int:
    """Returns how many bytes could be sent."""
    sent = 0
    try:
        while sent < most_bytes:
            connection.sendall(part)
            sent += len(part)
    except ConnectionError:
        pass
    return sent


def test_a_body_of_ten_gigabytes_is_refused_by_its_length(gateway: Served) -> None:
    head = f"POST /createFleet HTTP/1.1\r\nhost: {gateway.host}\r\ncontent-length: {10 * GIGABYTE}\r\n\r\n"
    with connected(gateway) as big:
        big.sendall(head.encode())
        assert b" 413 " in said(big)
    with connected(gateway) as big:
        big.sendall(head.encode())
        assert sent_until_refused(big, bytes(1 << 20), 10 * GIGABYTE) < GIGABYTE
    assert gateway.answers()


def test_an_endless_body_in_chunks_is_refused(gateway: Served) -> None:
    with connected(gateway) as big:
        big.sendall(
            f"POST /createFleet HTTP/1.1\r\nhost: {gateway.host}\r\ntransfer-encoding: chunked\r\n\r\n".encode()
        )
        assert sent_until_refused(big, b"10000\r\n" + bytes(1 << 16) + b"\r\n", 10 * GIGABYTE) < GIGABYTE
    assert gateway.answers()


def test_a_body_is_not_read_for_a_stranger(gateway: Served) -> None:
    with connected(gateway) as stranger:
        stranger.sendall(
            f"POST /createFleet HTTP/1.1\r\nhost: {gateway.host}\r\ncontent-length: 1000000\r\n\r\n".encode()
        )
        assert b" 403 " in said(stranger)


def test_of_many_large_bodies_at_once_some_are_told_to_come_later(unsigned: Served) -> None:
    head = f"POST /createFleet HTTP/1.1\r\nhost: {unsigned.host}\r\ncontent-length: 8000000\r\n\r\n".encode()
    part = bytes(7_000_000)
    with ExitStack() as stack:
        clients = [stack.enter_context(connected(unsigned)) for _ in range(60)]
        for each in clients:
            each.settimeout(2)
            with suppress(OSError):
                each.sendall(head + part)
        answered, _, _ = select.select(clients, [], [], 60)
        assert any(b" 503 " in said_so_far(each) for each in answered)
    assert _status(unsigned, f"host: {unsigned.host}") == b"400"


def test_a_head_without_end_is_refused(gateway: Served) -> None:
    with connected(gateway) as long:
        long.sendall(b"POST /createFleet HTTP/1.1\r\n")
        assert sent_until_refused(long, b"a: " + b"b" * 1000 + b"\r\n", 1 << 24) < 1 << 24
    with connected(gateway) as many:
        many.sendall(f"POST /createFleet HTTP/1.1\r\nhost: {gateway.host}\r\n".encode() + b"a: b\r\n" * 200 + b"\r\n")
        assert b" 431 " in said(many)
    assert gateway.answers()


def test_no_answer_lets_another_site_read_it(unsigned: Served) -> None:
    with connected(unsigned) as browser:
        browser.sendall(
            f"OPTIONS /createFleet HTTP/1.1\r\nhost: {unsigned.host}\r\norigin: http://evil.example\r\n"
            "access-control-request-method: POST\r\nconnection: close\r\n\r\n".encode()
        )
        assert b"access-control" not in said(browser).lower()


def _status(gateway: Served, headers: str) -> bytes:
    """Returns the status of a request about a fleet that is not there: 400 for who is let in."""
    head = f"POST /describeFleet HTTP/1.1\r\n{headers}\r\nconnection: close\r\ncontent-length: {len(NOBODY)}\r\n\r\n"
    with connected(gateway) as client:
        client.sendall(head.encode() + NOBODY)
        return said(client).split(b" ")[1]
