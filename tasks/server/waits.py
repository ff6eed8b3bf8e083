"""Waits of Prefect's server that Simyard's servers do without: for a busy database, and for readers that have left.

Prefect begins a transaction of SQLite as one that reads. Where another one writes before its own first write, SQLite
refuses that at once, and Prefect answers 503. Its client then waits for two seconds, although the database is free
again after a few milliseconds (docs/reference/prefect.md, section 3). What was refused is rolled back, so that a
second try does nothing twice.

A WebSocket that tells of events looks once a second whether its reader is still there, and a server that ends waits
for that.
"""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress

from tasks.server.own_origin import Application, Message, Receive, Scope, Send

_BUSY = 503
PAUSES_S = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4)
# A request of more is handed on as it comes, once: it is not kept for a second try.
_MOST_KEPT_BYTES = 4_000_000
_TELLING = "/out"  # how the paths of WebSockets end that only tell
_MOST_HEARD = 8


class BusyDatabase:
    """An ASGI application around another, which tries again what that refuses as busy."""

    def __init__(self, application: Application, pauses_s: Sequence[float] = PAUSES_S) -> None:
        """Watches an application.

        Args:
            application: Whose answers are watched.
            pauses_s: Before each further try; after the last one the refusal goes to the client.
        """
        self._application = application
        self._pauses_s = tuple(pauses_s)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers a request by the first try that is not refused, or by the last one."""
        if scope["type"] != "http":
            await self._application(scope, receive, send)
            return
        kept, is_whole = await _body(receive)
        for pause_s in self._pauses_s if is_whole else ():
            answer = _Answer(send)
            try:
                await self._application({**scope, "state": {**scope.get("state", {})}}, _again(kept, receive), answer)
            except Exception:
                if not answer.is_refusal:
                    raise  # Prefect raises what it has answered with 503 already
            if not answer.is_refusal:
                return
            await asyncio.sleep(pause_s)
        await self._application(scope, _again(kept, receive), send)


class LeftReader:
    """An ASGI application around another, which stops telling a reader that has left."""

    def __init__(self, application: Application) -> None:
        """Watches an application's readers."""
        self._application = application

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers a request; ends the answer of one that only tells with its reader."""
        if scope["type"] != "websocket" or not scope["path"].endswith(_TELLING):
            await self._application(scope, receive, send)
            return
        heard: asyncio.Queue[Message] = asyncio.Queue(_MOST_HEARD)
        telling = asyncio.ensure_future(self._application(scope, heard.get, send))
        hearing = asyncio.ensure_future(_hear_to_end(receive, heard))
        try:
            await asyncio.wait({telling, hearing}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            hearing.cancel()
            if not telling.done():
                telling.cancel()
        with suppress(asyncio.CancelledError):
            await telling


class _Answer:
    """Hands an answer on, unless it is the refusal of a busy database."""

    def __init__(self, send: Send) -> None:
        self._send = send
        self.is_refusal = False

    async def __call__(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.is_refusal = message["status"] == _BUSY
        if not self.is_refusal:
            await self._send(message)


async def _hear_to_end(receive: Receive, heard: asyncio.Queue[Message]) -> None:
    message: Message = {"type": ""}
    while message["type"] != "websocket.disconnect":
        message = await receive()
        await heard.put(message)


async def _body(receive: Receive) -> tuple[list[Message], bool]:
    """Returns the messages of a request's body, and whether they are all of it."""
    kept: list[Message] = []
    async for message in _messages(receive):
        kept.append(message)
        if sum(len(each.get("body", b"")) for each in kept) > _MOST_KEPT_BYTES:
            return kept, not message.get("more_body", False)
    return kept, True


async def _messages(receive: Receive) -> AsyncIterator[Message]:
    while True:
        message = await receive()
        yield message
        if message["type"] != "http.request" or not message.get("more_body", False):
            return


def _again(kept: Sequence[Message], receive: Receive) -> Receive:
    """Returns what gives the kept messages once more, then what comes after them."""
    left = iter(kept)

    async def received() -> Message:
        return next(left, None) or await receive()

    return received
