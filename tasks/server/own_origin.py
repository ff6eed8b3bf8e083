"""A web application that answers only who asks for it by its own name, and only pages of its own.

A page of any website may send requests to a server on this machine, and a name of an attacker's may lead to it (DNS
rebinding). A browser says which name it asked for (``Host``) and which page asks (``Origin``), on every request of a
page that could change or read anything, and on every WebSocket.
"""

from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from typing import Any

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
