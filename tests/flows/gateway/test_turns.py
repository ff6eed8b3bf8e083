"""Who is answered when, where one asks for much: by the ASGI application, with requests that are answered when told."""

import asyncio
import threading
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass, field
from typing import Any

import pytest

from flows.gateway.application import HEALTH, Admitted, Application, Calls
from flows.gateway.gateway import Gateway
from flows.gateway.handlers import HANDLERS
from specs.robomaker.operations import OPERATIONS
from tasks.gateway.access.guard import Caller, LoopbackGuard, loopback_hosts
from tasks.gateway.rest_json import HttpAnswer, HttpRequest
from tasks.storage.base.store import Store
from tests.factories.gateway.robomaker_client import HOST

_ENDS_A_HANG_S = 60


class Held(Calls):
    """Answers a request of ``/held/...`` when it is freed, and every other at once."""

    def __init__(self, store: Store) -> None:
        super().__init__(Gateway(store, lambda: None), HANDLERS, _Named(loopback_hosts(8600)))
        self.free, self.begun = threading.Event(), list[str]()

    def answer(self, admitted: Admitted) -> HttpAnswer:
        self.begun.append(admitted.request.raw_path)
        if admitted.request.raw_path.startswith("/held"):
            assert self.free.wait(_ENDS_A_HANG_S)
        return HttpAnswer(200, b"{}")


class _Named(LoopbackGuard):
    """Believes who says whose key it has."""

    def admit(self, request: HttpRequest, operation: object) -> Caller | HttpAnswer:  # noqa: ARG002 - asked for by Guard
        return Caller(dict(request.headers).get("x-key", ""))


@dataclass
class Client:
    """One request of a client that may leave before it is answered."""

    application: Application
    path: str
    key: str = ""
    address: str = "192.0.2.1"
    method: str = "POST"
    has_left: bool = False
    statuses: list[int] = field(default_factory=list[int])

    async def ask(self) -> None:
        headers = [(b"host", HOST.encode()), (b"x-key", self.key.encode())]
        scope: MutableMapping[str, Any] = {"type": "http", "method": self.method, "raw_path": self.path.encode()}
        scope |= {"query_string": b"", "headers": headers, "client": (self.address, 1)}
        told: list[MutableMapping[str, Any]] = [{"type": "http.request", "body": b"{}"}]

        async def receive() -> MutableMapping[str, Any]:
            while not told and not self.has_left:
                await asyncio.sleep(0.01)
            return told.pop() if told else {"type": "http.disconnect"}

        async def send(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                self.statuses.append(message["status"])

        await self.application(scope, receive, send)


Play = Callable[[Held, Callable[..., Client]], Awaitable[None]]


def played(store: Store, play: Play, threads: int = 4) -> Held:
    """Plays some clients, and lets all be answered that still wait in the end."""
    calls = Held(store)

    async def run() -> None:
        application, tasks = Application(calls, threads), list[asyncio.Task[None]]()

        def client(path: str, key: str = "", **given: Any) -> Client:  # noqa: ANN401 - fields of Client
            made = Client(application, path, key, **given)
            tasks.append(asyncio.create_task(made.ask()))
            return made

        try:
            async with asyncio.timeout(_ENDS_A_HANG_S):
                await play(calls, client)
        finally:
            calls.free.set()
        await asyncio.gather(*tasks)

    asyncio.run(run())
    return calls


async def answered(client: Client) -> int:
    """Returns the status of a client's answer, once it is there."""
    while not client.statuses:
        await asyncio.sleep(0.01)
    return client.statuses[0]


async def begun(calls: Held, number: int) -> None:
    """Waits until so many requests are being answered."""
    while len(calls.begun) < number:
        await asyncio.sleep(0.01)


@pytest.mark.parametrize("other", [{"key": "owner"}, {"address": "192.0.2.2"}])
def test_who_asks_for_much_holds_up_nobody_else(file_store: Store, other: dict[str, str]) -> None:
    async def play(calls: Held, client: Callable[..., Client]) -> None:
        crowd = [client(f"/held/{number}", "" if "address" in other else "reader") for number in range(40)]
        await begun(calls, 2)
        assert await answered(client("/owned", **other)) == 200
        assert not any(each.statuses for each in crowd)

    played(file_store, play)


@pytest.mark.parametrize("operation", [name for name in OPERATIONS if name.startswith("Cancel")])
def test_a_cancellation_waits_for_nothing_else_of_the_same_key(file_store: Store, operation: str) -> None:
    async def play(calls: Held, client: Callable[..., Client]) -> None:
        for number in range(40):
            client(f"/held/{number}", "owner")
        await begun(calls, 2)
        assert await answered(client(OPERATIONS[operation].path, "owner")) == 200

    played(file_store, play)


def test_those_who_wait_are_answered_in_turn(file_store: Store) -> None:
    async def play(calls: Held, client: Callable[..., Client]) -> None:
        for number in range(6):
            client(f"/held/a{number}", "a")
        await begun(calls, 1)
        for key in ("b", "c"):
            for number in range(2):
                client(f"/held/{key}{number}", key)

    order = [path.removeprefix("/held/") for path in played(file_store, play, threads=1).begun]
    assert order == ["a0", "a1", "b0", "c0", "a2", "b1", "c1", "a3", "a4", "a5"]


def test_of_one_key_only_so_many_requests_wait(file_store: Store) -> None:
    async def play(calls: Held, client: Callable[..., Client]) -> None:
        crowd = [client(f"/held/{number}", "reader") for number in range(200)]
        await begun(calls, 2)
        turned_away = [each for each in crowd if each.statuses]
        assert (len(turned_away), {await answered(each) for each in turned_away}) == (200 - 64 - 2, {400})
        assert await answered(client("/owned", "owner")) == 200

    played(file_store, play)


def test_nothing_is_done_for_who_left_while_they_waited(file_store: Store) -> None:
    async def play(calls: Held, client: Callable[..., Client]) -> None:
        crowd = [client(f"/held/{number}", "reader") for number in range(10)]
        await begun(calls, 2)
        for each in crowd[2:]:
            each.has_left = True

    assert sorted(played(file_store, play).begun) == ["/held/0", "/held/1"]


def test_whoever_watches_the_process_is_answered_whatever_is_going_on(file_store: Store) -> None:
    async def play(calls: Held, client: Callable[..., Client]) -> None:
        for number in range(8):
            client(f"/held/{number}", f"key-{number}")
        await begun(calls, 4)
        assert await answered(client(HEALTH, method="GET")) == 200

    played(file_store, play)
