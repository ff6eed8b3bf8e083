import socket

import pytest

from specs.errors import DocumentError
from tasks.gateway.connections import bound_socket


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
