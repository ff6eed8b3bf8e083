"""Connections: how many, how slow, and how encrypted."""

import socket
import ssl
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from specs.errors import DocumentError
from tasks.gateway.connections import Bounds, Connections, bound_socket, tls_context
from tests.gateway.small_server import REQUEST, all_of, small_server
from tests.servers.eventually import eventually

LONG_S = 30
PATIENT = Bounds(head_s=LONG_S, request_s=LONG_S, answer_s=LONG_S, idle_s=LONG_S)


@dataclass(eq=False)
class Fake:
    dropped: list[bool] = field(default_factory=list[bool])

    def drop(self) -> None:
        self.dropped.append(True)


def test_who_waited_longest_gives_way() -> None:
    known = Connections(Bounds(open=10, of_client=2))
    first, second, third = Fake(), Fake(), Fake()
    assert all(known.admit(each, "10.0.0.1") for each in (first, second))
    known.wait(first)  # asked and was answered since
    assert known.admit(third, "10.0.0.1")
    assert (first.dropped, second.dropped, len(known)) == ([], [True], 2)


def test_who_is_being_answered_does_not_give_way() -> None:
    known = Connections(Bounds(open=10, of_client=1))
    first = Fake()
    known.admit(first, "10.0.0.1")
    known.busy(first)
    assert not known.admit(Fake(), "10.0.0.1")
    assert known.admit(Fake(), "10.0.0.2")
    known.forget(first)
    assert known.admit(Fake(), "10.0.0.1")


def test_one_client_does_not_take_the_places_of_others() -> None:
    known = Connections(Bounds(open=3, of_client=2))
    other = Fake()
    known.admit(other, "10.0.0.9")
    assert all(known.admit(Fake(), "10.0.0.1") for _ in range(10))
    assert not other.dropped


def test_a_network_of_ipv6_is_one_client() -> None:
    known = Connections(Bounds(open=10, of_client=1))
    first = Fake()
    known.admit(first, "2001:db8::1")
    known.admit(Fake(), "2001:db8::ffff:1")
    assert first.dropped
    known.admit(Fake(), "2001:db8:0:1::1")
    assert len(known) == 2


def test_two_addresses_of_ipv4_that_are_written_as_ipv6_are_two_clients() -> None:
    known = Connections(Bounds(open=10, of_client=1))
    assert known.admit(Fake(), "::ffff:10.0.0.1")
    assert known.admit(Fake(), "::ffff:10.0.0.2")
    assert len(known) == 2


def test_what_is_forgotten_leaves_nothing() -> None:
    known = Connections(Bounds())
    for _ in range(3):
        each = Fake()
        known.admit(each, "::ffff:10.0.0.1")
        known.forget(each)
        known.forget(each)
        known.wait(each)
    assert (len(known), known._counts, known._waiting) == (0, {}, {})


def is_cut_off(slow: socket.socket) -> bool:
    """Returns whether a client that sends a byte at a time is cut off before it has sent 400."""
    try:
        for _ in range(400):
            slow.sendall(b"a")
            time.sleep(0.01)
    except OSError:
        return True
    return False


def test_a_connection_that_says_nothing_ends() -> None:
    with small_server(PATIENT._replace(head_s=0.1)) as server, server.connect() as silent:
        assert all_of(silent) == b""


def test_a_head_that_comes_byte_by_byte_is_cut_off() -> None:
    with small_server(PATIENT._replace(head_s=0.2)) as server, server.connect() as slow:
        assert is_cut_off(slow)


def test_a_body_that_comes_byte_by_byte_is_cut_off() -> None:
    with small_server(PATIENT._replace(request_s=0.2)) as server, server.connect() as slow:
        slow.sendall(b"POST / HTTP/1.1\r\nhost: a\r\ncontent-length: 1000000\r\n\r\n")
        assert is_cut_off(slow)


def test_who_does_not_read_the_answer_is_cut_off() -> None:
    with small_server(PATIENT._replace(answer_s=0.2)) as server, socket.socket() as idle:
        idle.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        idle.connect(("127.0.0.1", server.port))
        idle.sendall(b"GET /big HTTP/1.1\r\nhost: a\r\n\r\n")
        assert idle.recv(1)  # it is being answered
        eventually(lambda: len(server.connections) == 0)
        assert len(all_of(idle)) < 8 << 20


def test_who_reads_gets_all_of_a_big_answer() -> None:
    with small_server(PATIENT) as server, server.connect() as reader:
        reader.sendall(b"GET /big HTTP/1.1\r\nhost: a\r\nconnection: close\r\n\r\n")
        assert len(all_of(reader)) > 8 << 20


def test_an_idle_connection_ends() -> None:
    with small_server(PATIENT._replace(idle_s=0.1)) as server, server.connect() as idle:
        idle.sendall(REQUEST)
        assert all_of(idle).endswith(b"\r\n\r\n0")


def test_requests_one_after_another_and_at_once_are_answered() -> None:
    with small_server(PATIENT) as server, server.connect() as client:
        client.sendall(REQUEST)
        found = b""
        while not found.endswith(b"\r\n\r\n0"):
            found += client.recv(1000)
        client.sendall(REQUEST * 3 + REQUEST.replace(b"host: a", b"host: a\r\nconnection: close"))
        assert all_of(client).count(b"200 OK") == 4


def test_half_a_request_behind_a_whole_one_is_cut_off() -> None:
    with small_server(PATIENT._replace(head_s=0.2)) as server, server.connect() as client:
        client.sendall(REQUEST + b"GET / HT")
        assert all_of(client).count(b"200 OK") == 1


def test_a_new_client_takes_the_place_of_one_that_waits() -> None:
    with small_server(PATIENT._replace(open=20, of_client=20)) as server:
        waiting = [server.connect() for _ in range(60)]
        for _ in range(5):
            with server.connect() as client:
                client.sendall(REQUEST)
                assert b"200 OK" in client.recv(1000)
        assert len(server.connections) <= 20
        for each in waiting:
            each.close()


def test_many_small_chunks_hold_nobody_up() -> None:
    with small_server(PATIENT) as server, server.connect() as hostile:
        head = b"POST / HTTP/1.1\r\nhost: a\r\ntransfer-encoding: chunked\r\n\r\n"
        hostile.sendall(head + b"1\r\na\r\n" * 5000)
        assert b" 411 " in all_of(hostile)


@pytest.fixture
def certificate(tmp_path: Path) -> tuple[Path, Path]:
    files = tmp_path / "certificate.pem", tmp_path / "key.pem"
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"),
            *("-days", "2", "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"),
            *("-out", str(files[0]), "-keyout", str(files[1])),
        ],
        check=True,
        capture_output=True,
    )
    return files


def test_requests_are_answered_by_tls(certificate: tuple[Path, Path]) -> None:
    client = ssl.create_default_context(cafile=str(certificate[0]))
    with small_server(PATIENT, tls_context(*certificate)) as server:
        for _ in range(5):
            with client.wrap_socket(server.connect(), server_hostname="localhost") as secure:
                secure.sendall(REQUEST + REQUEST.replace(b"host: a", b"host: a\r\nconnection: close"))
                assert all_of(secure).count(b"200 OK") == 2


def test_half_an_agreement_on_tls_ends_and_keeps_nobody_out(certificate: tuple[Path, Path]) -> None:
    client = ssl.create_default_context(cafile=str(certificate[0]))
    with small_server(PATIENT._replace(open=10, of_client=10), tls_context(*certificate)) as server:
        waiting = [server.connect() for _ in range(30)]
        with client.wrap_socket(server.connect(), server_hostname="localhost") as secure:
            secure.sendall(REQUEST)
            assert b"200 OK" in secure.recv(1000)
        for each in waiting:
            each.close()
    with small_server(PATIENT._replace(head_s=0.1), tls_context(*certificate)) as server, server.connect() as silent:
        assert all_of(silent) == b""


def test_a_request_without_tls_is_not_answered(certificate: tuple[Path, Path]) -> None:
    with small_server(PATIENT, tls_context(*certificate)) as server, server.connect() as plain:
        plain.sendall(REQUEST)
        assert b"HTTP" not in all_of(plain)
        assert len(server.connections) <= 1


def test_old_versions_of_tls_are_refused(certificate: tuple[Path, Path]) -> None:
    context = tls_context(*certificate)
    assert context is not None
    assert context.minimum_version == ssl.TLSVersion.TLSv1_2


def test_files_that_do_not_fit_are_refused(certificate: tuple[Path, Path], tmp_path: Path) -> None:
    assert tls_context(None, None) is None
    for one, other in (
        (certificate[0], None),
        (None, certificate[1]),
        certificate[::-1],
        (tmp_path / "x", certificate[1]),
    ):
        with pytest.raises(DocumentError, match="TLS"):
            tls_context(one, other)


def test_a_taken_port_is_told_with_the_option_that_names_another():
    with bound_socket("127.0.0.1", 0) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(DocumentError, match=f"--port: '{port}': .* in use"):
            bound_socket("127.0.0.1", port)


def test_an_address_of_another_machine_is_refused():
    with pytest.raises(DocumentError, match="an address of this machine"):
        bound_socket("192.0.2.1", 0)


def test_small_answers_are_sent_at_once():
    # What asyncio looks at before it sets TCP_NODELAY; without it each answer waits 40 ms for an acknowledgement.
    with bound_socket("127.0.0.1", 0) as bound:
        assert bound.proto == socket.IPPROTO_TCP
