"""Requests that a busy database refuses are tried again, and nobody tells a reader that has left."""

import asyncio
from collections.abc import Callable, Iterable

import pytest

from tasks.server.guarded_server import Application, BusyDatabase, LeftReader, Message, Receive, Scope, Send

POST = {"type": "http", "method": "POST", "path": "/api/artifacts/"}
_BODY = [b"half, ", b"and half"]


class Refusals:
    """An application that refuses as many times as it is told, as Prefect does: it answers, and raises."""

    def __init__(self, refusals: int) -> None:
        self.bodies: list[bytes] = []
        self._left = refusals

    async def __call__(self, _scope: Scope, receive: Receive, send: Send) -> None:
        self.bodies.append(await _whole(receive))
        status = 503 if self._left else 201
        await send({"type": "http.response.start", "status": status, "headers": []})
        await send({"type": "http.response.body", "body": b""})
        if self._left:
            self._left -= 1
            raise RuntimeError("database is locked")


def test_what_is_refused_once_is_answered_by_the_second_try_with_the_whole_body():
    application = Refusals(1)

    assert _statuses(BusyDatabase(application, (0.0, 0.0))) == [201]
    assert application.bodies == [b"".join(_BODY)] * 2


def test_the_last_refusal_reaches_the_client():
    application = Refusals(9)

    sent: list[Message] = []
    with pytest.raises(RuntimeError):
        _ask(BusyDatabase(application, (0.0, 0.0)), sent.append)

    assert [each["status"] for each in sent if "status" in each] == [503]
    assert len(application.bodies) == 3


def test_another_failure_is_not_tried_again():
    asked: list[Scope] = []

    async def failing(scope: Scope, _receive: Receive, _send: Send) -> None:
        asked.append(scope)
        raise LookupError

    with pytest.raises(LookupError):
        _ask(BusyDatabase(failing, (0.0,)), lambda _: None)
    assert len(asked) == 1


def test_who_tells_events_is_stopped_when_the_reader_leaves():
    heard: list[str] = []

    async def telling(_scope: Scope, receive: Receive, _send: Send) -> None:
        heard.append((await receive())["type"])
        await asyncio.Event().wait()  # looks at its reader only now and then

    messages: list[Message] = [{"type": "websocket.connect"}, {"type": "websocket.disconnect"}]

    async def receive() -> Message:
        await asyncio.sleep(0)
        return messages.pop(0)

    async def send(_message: Message) -> None:
        pass

    async def answered() -> None:
        scope = {"type": "websocket", "path": "/api/events/out"}
        await asyncio.wait_for(LeftReader(telling)(scope, receive, send), 10.0)

    asyncio.run(answered())
    assert heard == ["websocket.connect"]


def _statuses(application: Application) -> list[int]:
    sent: list[Message] = []
    _ask(application, sent.append)
    return [each["status"] for each in sent if "status" in each]


def _ask(application: Application, hear: Callable[[Message], None]) -> None:
    left = iter(_parts(_BODY))

    async def receive() -> Message:
        return next(left)

    async def send(message: Message) -> None:
        hear(message)

    async def answered() -> None:
        await application(dict(POST), receive, send)

    asyncio.run(answered())


def _parts(body: Iterable[bytes]) -> list[Message]:
    parts: list[Message] = [{"type": "http.request", "body": each, "more_body": True} for each in body]
    return [*parts[:-1], {**parts[-1], "more_body": False}]


async def _whole(receive: Receive) -> bytes:
    found = b""
    while (message := await receive())["type"] == "http.request":
        found += message["body"]
        if not message["more_body"]:
            break
    return found
