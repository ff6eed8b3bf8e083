"""Somebody with a key that may only read reloads a page on many connections; and guesses at the door of others.

Whose turn it is, request by request: tests/flows/gateway/test_turns.py. Endless bodies and heads: test_floods.py.
"""

import http.client
import statistics
import threading
from collections.abc import Iterator
from contextlib import suppress

import pytest

from tests.factories.gateway.served import Served, served

pytestmark = [pytest.mark.integration, pytest.mark.long]
WORLDS, CONNECTIONS = 1500, 60
FORM = {"content-type": "application/x-www-form-urlencoded"}


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("crowded") / "s") as found:
        for number in range(WORLDS):
            world = found.store / "worlds" / f"g{number // 50}" / f"w{number % 50}.json"
            world.parent.mkdir(parents=True, exist_ok=True)
            world.write_bytes(b"{}")
        yield found


class Crowd:
    """Connections that ask for a page again and again.

    Args:
        gateway: What they ask.
        cookie: Of the key that all of them have.
    """

    def __init__(self, gateway: Served, cookie: str) -> None:
        self.answers = 0
        self._gateway, self._cookie, self._over = gateway, cookie, threading.Event()
        self._threads = [threading.Thread(target=self._reload) for _ in range(CONNECTIONS)]
        self._lock = threading.Lock()

    def __enter__(self) -> "Crowd":
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        for thread in self._threads:
            thread.join()

    def _reload(self) -> None:
        connection = http.client.HTTPConnection("127.0.0.1", self._gateway.port)
        while not self._over.is_set():
            with suppress(ConnectionError, http.client.HTTPException):
                connection.request("GET", "/worlds", headers={"host": self._gateway.host, "cookie": self._cookie})
                connection.getresponse().read()
                with self._lock:
                    self.answers += 1
        connection.close()


def test_who_reloads_a_page_on_many_connections_is_not_answered_before_everybody_else(gateway: Served) -> None:
    """In one line for all, each of the owner's requests comes after one of every other connection."""
    before: list[int] = []
    with Crowd(gateway, gateway.signed_in(gateway.key("reader", "read"))) as crowd:
        while crowd.answers < CONNECTIONS:
            assert gateway.answers()
        for _ in range(9):
            began = crowd.answers
            assert gateway.answers()
            before.append(crowd.answers - began)
    assert statistics.median(before) < CONNECTIONS / 2, before


def test_who_guesses_keeps_nobody_of_the_same_address_from_signing_in(gateway: Served) -> None:
    """Behind a proxy all come from one address; six wrong secrets locked all of them out."""
    headers = {"host": gateway.host, "origin": f"http://{gateway.host}", **FORM}
    for number in range(8):
        connection = http.client.HTTPConnection("127.0.0.1", gateway.port)
        connection.request("POST", "/sign-in", f"key={gateway.owner.key_id}&secret={number}&back=/", headers)
        connection.getresponse().read()
        connection.close()
    assert gateway.page("/fleets", gateway.signed_in())[0] == 200
