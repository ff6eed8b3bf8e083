"""The ASGI application: requests from the wire to a pool of threads, as the store blocks, and answers back."""

import asyncio
import uuid
from collections.abc import Awaitable, Callable, MutableMapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

from flows.gateway.calls import Calls
from specs.errors import AccessRefused
from tasks.gateway.connection.body import BodyRoom, check_head
from tasks.gateway.error_answers import error_answer
from tasks.gateway.messages import HttpAnswer, HttpRequest

MOST_BODY_BYTES = 8 << 20
"""RoboMaker's largest request, a batch of 1,000 jobs, has some 4 MB with all that it may say."""
_CLOSE = {"connection": "close"}
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
        self._room = BodyRoom()
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="request")

    async def __call__(self, scope: _Message, receive: _Receive, send: _Send) -> None:
        """Answers one request, or the server's own beginning and end."""
        if scope["type"] == "lifespan":
            await self._live(receive, send)
        elif scope["type"] == "http":
            await self._answer(scope, receive, send)

    async def _answer(self, scope: _Message, receive: _Receive, send: _Send) -> None:
        head = _request(scope)
        loop = asyncio.get_running_loop()
        try:
            check_head(head.headers, MOST_BODY_BYTES)
            if self._calls.refuse_head(head):
                # Asked again in a thread, for it may be written down. A body may follow that nobody reads.
                answer = await loop.run_in_executor(self._pool, self._calls.answer, head)
                await _send(send, replace(answer, headers={**answer.headers, **_CLOSE}), head.id)
                return
            with self._room.place() as place:
                body = await place.read(receive, MOST_BODY_BYTES)
                if body is not None:
                    request = replace(head, body=body)
                    await _send(send, await loop.run_in_executor(self._pool, self._calls.answer, request), head.id)
        except AccessRefused as exc:
            refused = error_answer(exc.status, exc.code, str(exc))
            await _send(send, replace(refused, headers=_CLOSE), head.id)

    async def _live(self, receive: _Receive, send: _Send) -> None:
        while True:
            kind = (await receive())["type"]
            if kind == "lifespan.shutdown":
                self._pool.shutdown(wait=True)
            await send({"type": f"{kind}.complete"})
            if kind == "lifespan.shutdown":
                return


def _request(scope: _Message) -> HttpRequest:
    headers = tuple((name.decode("latin-1").lower(), value.decode("latin-1")) for name, value in scope["headers"])
    # The decoded path of the scope has no ARNs any more: their slashes are encoded.
    raw_path, query = scope["raw_path"].decode("latin-1"), scope["query_string"].decode("latin-1")
    client = scope.get("client") or ("",)
    return HttpRequest(scope["method"], raw_path, query, headers, b"", str(client[0]), str(uuid.uuid4()))


async def _send(send: _Send, answer: HttpAnswer, request_id: str) -> None:
    headers = {
        "content-type": answer.content_type,
        "content-length": str(len(answer.body)),
        "x-amzn-requestid": request_id,
        **({"x-amzn-errortype": answer.error} if answer.error else {}),
        **answer.headers,
    }
    encoded = [(name.lower().encode("latin-1"), value.encode("latin-1")) for name, value in headers.items()]
    await send({"type": "http.response.start", "status": answer.status, "headers": encoded})
    await send({"type": "http.response.body", "body": answer.body})
