"""Prefect's server, for this machine and its own pages only: the program of the servers that Simyard starts.

Run as ``python -m tasks.server.guarded_server PORT [--reserve]``: in reserve it imports, and starts when its input says
so. It is what ``prefect server start`` is, but for the application that stands before Prefect's: Prefect has no setting
for the names that its server answers to. Its password comes in PREFECT_SERVER_API_AUTH_STRING, where no other account
of the machine sees it.
"""

import asyncio
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, MutableMapping, Sequence
from contextlib import suppress
from typing import Any

from tasks.server.process import PRESTARTED
from tasks.server.watchdog import pause_collector

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]

# No page of another origin may show ours in a frame, to have somebody click in it.
_NO_FRAMES = [(b"x-frame-options", b"DENY"), (b"content-security-policy", b"frame-ancestors 'none'")]
_REFUSALS = {
    "host": b"refused: this server is asked for by 127.0.0.1 or localhost and its port only",
    "origin": b"refused: pages of other origins may not ask this server",
}
_BUSY = 503
PAUSES_S = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4)
# A request of more is handed on as it comes, once: it is not kept for a second try.
_MOST_KEPT_BYTES = 4_000_000
_TELLING = "/out"  # how the paths of WebSockets end that only tell
_MOST_HEARD = 8
_HERE = ("127.0.0.1", "localhost")


# A page of any website may send requests to a server on this machine, and a name of an attacker's may lead to it (DNS
# rebinding). A browser says which name it asked for (``Host``) and which page asks (``Origin``), on every request of
# a page that could change or read anything, and on every WebSocket.
class OwnOrigin:
    """An ASGI application around another, which sees no request by another name or of another page's."""

    def __init__(self, application: Application, hosts: Iterable[str]) -> None:
        """Guards an application.

        Args:
            application: What is guarded.
            hosts: Its names with their ports, such as ``localhost:4200``.
        """
        self._application = application
        self._hosts = frozenset(host.encode() for host in hosts)
        self._origins = frozenset(b"http://" + host for host in self._hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers a request, or lets the application do so."""
        if scope["type"] not in {"http", "websocket"}:
            await self._application(scope, receive, send)
        elif wrong := self._wrong(scope):
            await _refuse(scope, send, _REFUSALS[wrong])
        else:
            await self._application(scope, receive, _unframed(send) if scope["type"] == "http" else send)

    def _wrong(self, scope: Scope) -> str | None:
        """Returns which of the two headers is wrong; a program that is no browser sends no origin."""
        headers: list[tuple[bytes, bytes]] = list(scope["headers"])
        hosts = [value.lower() for name, value in headers if name == b"host"]
        origins = [value.lower() for name, value in headers if name == b"origin"]
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return "host"
        return None if all(origin in self._origins for origin in origins) else "origin"


async def _refuse(scope: Scope, send: Send, why: bytes) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})  # before it is accepted: an answer with status 403
        return
    length = str(len(why)).encode()
    headers = [(b"content-type", b"text/plain"), (b"content-length", length), *_NO_FRAMES]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": why})


def _unframed(send: Send) -> Send:
    async def sent(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", ()), *_NO_FRAMES]
        await send(message)

    return sent


# Prefect begins a transaction of SQLite as one that reads. Where another one writes before its own first write,
# SQLite refuses that at once, and Prefect answers 503. Its client then waits for two seconds, although the database
# is free again after a few milliseconds (docs/reference/prefect.md, section 3). What was refused is rolled back, so
# that a second try does nothing twice.
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


# A WebSocket that tells of events looks once a second whether its reader is still there, and a server that ends waits
# for that.
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


def main(arguments: list[str]) -> None:
    """Serves on a port of 127.0.0.1 until a signal ends it."""
    with pause_collector():
        import uvicorn  # noqa: PLC0415 - whoever needs this module's applications alone does not wait for Prefect
        from prefect.server.api.server import create_app  # noqa: PLC0415 - same
        from prefect.settings import get_current_settings  # noqa: PLC0415 - same

    port = int(arguments[0])
    if arguments[1:] == [PRESTARTED] and not sys.stdin.buffer.readline():
        return  # whoever began it has ended, or needs no server
    settings = get_current_settings().server
    with pause_collector():
        guarded = LeftReader(BusyDatabase(create_app(final=True)))
    uvicorn.run(
        OwnOrigin(guarded, [f"{name}:{port}" for name in _HERE]),  # pyright: ignore[reportArgumentType]
        host=_HERE[0],
        port=port,
        timeout_keep_alive=settings.api.keepalive_timeout,
        ws_ping_interval=settings.api.websocket_ping_interval,
        ws_ping_timeout=settings.api.websocket_ping_timeout,
        log_level=settings.logging_level.lower(),
    )


if __name__ == "__main__":
    main(sys.argv[1:])
