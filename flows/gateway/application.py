"""The ASGI application: requests from the wire to a pool of threads, as the store blocks, and answers back."""

import asyncio
import uuid
from collections.abc import Awaitable, Callable, MutableMapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from flows.gateway.calls import Calls
from tasks.gateway.error_answers import error_answer
from tasks.gateway.messages import HttpAnswer, HttpRequest

MOST_BODY_BYTES = 8 << 20
"""RoboMaker's largest request, a batch of 1,000 jobs, has some 4 MB with all that it may say."""
_AT_ONCE = 8
_Message = MutableMapping[str, Any]
_Receive = Callable[[], Awaitable[_Message]]
_Send = Callable[[_Message], Awaitable[None]]


class Application:
    """RoboMaker over HTTP, for an ASGI server.

    Args:
        calls: What answers.
        threads: How many requests are worked on at once.
    """

    def __init__(self, calls: Calls, threads: int = _AT_ONCE) -> None:
        self._calls = calls
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="request")

    async def __call__(self, scope: _Message, receive: _Receive, send: _Send) -> None:
        """Answers one request, or the server's own beginning and end."""
        if scope["type"] == "lifespan":
            await self._live(receive, send)
        elif scope["type"] == "http":
            await self._answer(scope, receive, send)

    async def _answer(self, scope: _Message, receive: _Receive, send: _Send) -> None:
        body = await _body(receive)
        if body is None:
            message = f"a request has at most {MOST_BODY_BYTES:,} bytes"
            await _send(send, error_answer(413, "RequestEntityTooLargeException", message))
            return
        loop = asyncio.get_running_loop()
        await _send(send, await loop.run_in_executor(self._pool, self._calls.answer, _request(scope, body)))

    async def _live(self, receive: _Receive, send: _Send) -> None:
        while True:
            kind = (await receive())["type"]
            if kind == "lifespan.shutdown":
                self._pool.shutdown(wait=True)
            await send({"type": f"{kind}.complete"})
            if kind == "lifespan.shutdown":
                return


def _request(scope: _Message, body: bytes) -> HttpRequest:
    headers = tuple((name.decode("latin-1").lower(), value.decode("latin-1")) for name, value in scope["headers"])
    # The decoded path of the scope has no ARNs any more: their slashes are encoded.
    raw_path, query = scope["raw_path"].decode("latin-1"), scope["query_string"].decode("latin-1")
    client = scope.get("client") or ("",)
    return HttpRequest(scope["method"], raw_path, query, headers, body, str(client[0]))


async def _body(receive: _Receive) -> bytes | None:
    """Returns the whole body; None if it is too large, or the client went away."""
    found = bytearray()
    while True:
        message = await receive()
        found += message.get("body", b"")
        if message["type"] != "http.request" or len(found) > MOST_BODY_BYTES:
            return None
        if not message.get("more_body", False):
            return bytes(found)


async def _send(send: _Send, answer: HttpAnswer) -> None:
    headers = {
        "content-type": answer.content_type,
        "content-length": str(len(answer.body)),
        "x-amzn-requestid": str(uuid.uuid4()),
        **({"x-amzn-errortype": answer.error} if answer.error else {}),
        **answer.headers,
    }
    encoded = [(name.lower().encode("latin-1"), value.encode("latin-1")) for name, value in headers.items()]
    await send({"type": "http.response.start", "status": answer.status, "headers": encoded})
    await send({"type": "http.response.body", "body": answer.body})
