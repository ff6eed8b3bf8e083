"""From a request to its answer: let in, read, permitted, handled, written.

The ASGI application hands requests from the wire to a pool of threads, as the store blocks, and answers back. Who asks
for much waits for itself: the threads are shared out in turn among those who ask.
"""

import asyncio
import logging
import time
import uuid
from collections import Counter, deque
from collections.abc import AsyncGenerator, Awaitable, Callable, MutableMapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any, NamedTuple

from flows.gateway.gateway import Gateway, Handlers
from specs.arn import ArnForm
from specs.base import Spec
from specs.errors import AccessRefused, SimyardError, StoreError
from specs.robomaker.operations import Operation, document_shapes
from specs.settings import region
from tasks.documents.parse import parse
from tasks.gateway.access.guard import Call, Caller, Guard, Note, no_note
from tasks.gateway.connections import SMALL_BYTES, BodyRoom, check_head, network_of
from tasks.gateway.rest_json import (
    ErrorAnswers,
    HttpAnswer,
    HttpRequest,
    Route,
    error_answer,
    request_members,
    route,
    with_arns,
    written,
)
from tasks.storage.store_url import store_id

_LOG = logging.getLogger(__name__)
HEALTH = "/ping"
"""Answers GET with 200 and nothing else, whoever asks, for whatever watches the process."""
Page = Callable[[HttpRequest], HttpAnswer | None]
"""Answers what is for no operation, such as a browser's ``GET /``; None if it knows no such page either."""
Reader = Callable[[HttpRequest], str]
"""Returns the id of the key that a browser has signed in with; empty if it has not."""
MOST_BODY_BYTES = 8 << 20
"""RoboMaker's largest request, a batch of 1,000 jobs, has some 4 MB with all that it may say."""
_CLOSE = {"connection": "close"}
_AT_ONCE, _MOST_WAITING = 8, 64
_CANCEL = "Cancel"
_Message = MutableMapping[str, Any]
_Receive = Callable[[], Awaitable[_Message]]
_Send = Callable[[_Message], Awaitable[None]]


def no_page(_request: HttpRequest) -> HttpAnswer | None:
    """Knows no page."""
    return None


def no_reader(_request: HttpRequest) -> str:
    """Knows nobody."""
    return ""


class Admitted(NamedTuple):
    """A request whose sender is known.

    Attributes:
        request: As it came.
        route: What it is for.
        caller: Who asks; or why it is refused.
        whose: Whom else it waits with: requests of the same key, or from the same place.
    """

    request: HttpRequest
    route: Route
    caller: Caller | HttpAnswer
    whose: str


class Calls:
    """Answers requests, several at once, each in a thread.

    Args:
        gateway: What the handlers have at hand.
        handlers: By operation.
        guard: Who lets requests in.
        page: What answers a browser.
        note: Keeps a line about each call.
        reader: Says whose browser asks.

    Raises:
        DocumentError: SIMYARD_REGION is no name of a region.
    """

    def __init__(
        self,
        gateway: Gateway,
        handlers: Handlers,
        guard: Guard,
        page: Page = no_page,
        note: Note = no_note,
        *,
        reader: Reader = no_reader,
    ) -> None:
        self._gateway, self._handlers, self._guard, self._page = gateway, handlers, guard, page
        self._note, self._reader = note, reader
        self._arns = ArnForm(store_id(gateway.store), region())
        self._errors = ErrorAnswers(self._arns, gateway.store.url)

    def refuse_head(self, request: HttpRequest) -> HttpAnswer | None:
        """Returns the refusal of a request whose body need not be read."""
        return None if request.raw_path == HEALTH else self._guard.refuse_head(request, route(request).operation)

    def admit(self, request: HttpRequest) -> Admitted:
        """Returns a request with who sent it; nothing is asked of the store, and no signature counts twice.

        To cancel something, nobody waits for what else they have asked for.
        """
        found = route(request)
        try:
            caller = self._guard.admit(request, found.operation)
            key = caller.key if isinstance(caller, Caller) else ""
            key = key or (self._reader(request) if found.operation is None else "")
        except Exception:  # noqa: BLE001 - the outermost frame of a request
            caller, key = _defect(request), ""
        is_urgent = found.operation is not None and found.operation.name.startswith(_CANCEL)
        return Admitted(request, found, caller, f"{_CANCEL * is_urgent} {key or network_of(request.client)}")

    def answer(self, admitted: Admitted) -> HttpAnswer:
        """Returns the answer to a request; whatever goes wrong is one of RoboMaker's errors."""
        began_s = time.perf_counter()
        try:
            call = self._call(admitted, began_s)
            return call.answer if self._is_noted(call) else _unnoted(call.answer)
        except Exception:  # noqa: BLE001 - the outermost frame of a request
            return _defect(admitted.request)

    def _is_noted(self, call: Call) -> bool:
        try:
            self._note(call)
        except StoreError as exc:
            _LOG.error("%s: no line in the log of actions: %s", call.request.id, exc)
            return False
        return True

    def _call(self, admitted: Admitted, began_s: float) -> Call:
        request, found, caller, _ = admitted
        document: Spec | None = None
        if isinstance(caller, HttpAnswer):
            caller, answer = None, caller
        elif found.operation is None:
            answer = self._page(request) or _unknown(request)
        else:
            document, answer = self._answered(found, found.operation, request, caller)
        return Call(request, answer, time.perf_counter() - began_s, caller, found.operation, document)

    def _answered(
        self, found: Route, operation: Operation, request: HttpRequest, caller: Caller
    ) -> tuple[Spec | None, HttpAnswer]:
        document: Spec | None = None
        try:
            document = self._document(found, operation, request)
            refusal = self._guard.permit(caller, operation, document)
            return document, refusal or self._handled(operation, document)
        except SimyardError as exc:
            _LOG.info("%s: %a", operation.name, str(exc)[:1000])
            return document, self._errors.answer(operation, exc)
        except Exception as exc:  # noqa: BLE001 - the outermost frame of an operation
            _LOG.exception("%s", operation.name)
            return document, self._errors.answer(operation, exc)

    def _document(self, found: Route, operation: Operation, request: HttpRequest) -> Spec:
        shape = document_shapes()[operation.request]
        members = request_members(found, request, shape)
        return parse(shape, with_arns(members, shape, self._arns.own), operation.name)

    def _handled(self, operation: Operation, document: Spec) -> HttpAnswer:
        answer = self._handlers[operation.name](self._gateway, document)
        members = answer.model_dump(mode="json", exclude_none=True)
        return written(with_arns(members, type(answer), self._arns.robomakers))


def _defect(request: HttpRequest) -> HttpAnswer:
    """Returns what is said of the exception that is being handled."""
    _LOG.exception("%s %a", request.method, request.raw_path[:200])
    return error_answer(500, "InternalServerException", "this is a defect of Simyard; its log says more")


def _unnoted(answer: HttpAnswer) -> HttpAnswer:
    """Returns what is said when the log of actions did not take the line: of what was refused, the refusal."""
    if answer.status >= 400:
        return answer
    message = "it was done, but the log of actions could not be written; the line follows with the next call"
    return error_answer(500, "InternalServerException", message)


def _unknown(request: HttpRequest) -> HttpAnswer:
    message = f"{request.method} {request.raw_path[:200]} is no operation of RoboMaker"
    return error_answer(404, "UnknownOperationException", message)


class _Turns:
    """Who is worked for next: one of those who wait, each in turn, however much each of them has asked for.

    One alone gets half of the threads, so that there is one for whoever else comes. Used by the event loop's thread.
    """

    def __init__(self, threads: int) -> None:
        self._free, self._of_one = threads, max(1, threads // 2)
        self._waiting: dict[str, deque[asyncio.Future[None]]] = {}  # who comes next is the first
        self._busy = Counter[str]()

    @asynccontextmanager
    async def turn(self, whose: str) -> AsyncGenerator[bool]:
        """Waits until it is somebody's turn; it ends with the ``with`` block, which gets whether they had to wait.

        Raises:
            AccessRefused: Too many of theirs wait already.
        """
        waiting = self._waiting.setdefault(whose, deque())
        if len(waiting) >= _MOST_WAITING:
            why = f"{_MOST_WAITING} of your requests wait already; try it again"
            raise AccessRefused("ThrottlingException", why, 400)
        place = asyncio.get_running_loop().create_future()
        waiting.append(place)
        self._grant()
        waits = not place.done()
        try:
            await place
            yield waits
        finally:
            if place.done() and not place.cancelled():
                self._free += 1
                self._busy[whose] -= 1
                if not self._busy[whose]:
                    del self._busy[whose]
                self._grant()

    def _grant(self) -> None:
        while self._free:
            whose = next((each for each in self._waiting if self._busy[each] < self._of_one), None)
            if whose is None:
                return
            waiting = self._waiting.pop(whose)
            place = waiting.popleft()
            if waiting:
                self._waiting[whose] = waiting  # behind all others
            if not place.cancelled():
                place.set_result(None)
                self._free -= 1
                self._busy[whose] += 1


class Application:
    """RoboMaker over HTTP, for an ASGI server.

    Args:
        calls: What answers.
        threads: How many requests are worked on at once.
    """

    def __init__(self, calls: Calls, threads: int = _AT_ONCE) -> None:
        self._calls = calls
        self._room, self._turns = BodyRoom(), _Turns(threads)
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="request")
        self._door = ThreadPoolExecutor(1, thread_name_prefix="large-request")

    async def __call__(self, scope: _Message, receive: _Receive, send: _Send) -> None:
        """Answers one request, or the server's own beginning and end."""
        if scope["type"] == "lifespan":
            await self._live(receive, send)
        elif scope["type"] == "http":
            await self._answer(scope, receive, send)

    async def _answer(self, scope: _Message, receive: _Receive, send: _Send) -> None:
        head = _request(scope)
        try:
            check_head(head.headers, MOST_BODY_BYTES)
            if head.raw_path == HEALTH and head.method in {"GET", "HEAD"}:
                await _send_answer(send, HttpAnswer(200, b"{}"), head.id)
            elif self._calls.refuse_head(head):
                # Asked again in a thread, for it may be written down. A body may follow that nobody reads.
                answer = await self._answered(self._calls.admit(head), receive)
                if answer is not None:
                    await _send_answer(send, replace(answer, headers={**answer.headers, **_CLOSE}), head.id)
            else:
                with self._room.place() as place:
                    body = await place.read(receive, MOST_BODY_BYTES)
                    request = replace(head, body=body or b"")
                    answer = await self._answered(await self._admitted(request), receive) if body is not None else None
                    if answer is not None:
                        await _send_answer(send, answer, head.id)
        except AccessRefused as exc:
            refused = error_answer(exc.status, exc.code, str(exc))
            await _send_answer(send, replace(refused, headers=_CLOSE), head.id)

    async def _admitted(self, request: HttpRequest) -> Admitted:
        if len(request.body) <= SMALL_BYTES:
            return self._calls.admit(request)
        # To hash megabytes would hold up everybody.
        return await asyncio.get_running_loop().run_in_executor(self._door, self._calls.admit, request)

    async def _answered(self, admitted: Admitted, receive: _Receive) -> HttpAnswer | None:
        """Returns the answer when it is the sender's turn; None if they left meanwhile, and nothing was done."""
        async with self._turns.turn(admitted.whose) as has_waited:
            if has_waited and await _has_left(receive):
                return None
            return await asyncio.get_running_loop().run_in_executor(self._pool, self._calls.answer, admitted)

    async def _live(self, receive: _Receive, send: _Send) -> None:
        while True:
            kind = (await receive())["type"]
            if kind == "lifespan.shutdown":
                self._pool.shutdown(wait=True)
                self._door.shutdown(wait=True)
            await send({"type": f"{kind}.complete"})
            if kind == "lifespan.shutdown":
                return


def _request(scope: _Message) -> HttpRequest:
    headers = tuple((name.decode("latin-1").lower(), value.decode("latin-1")) for name, value in scope["headers"])
    # The decoded path of the scope has no ARNs any more: their slashes are encoded.
    raw_path, query = scope["raw_path"].decode("latin-1"), scope["query_string"].decode("latin-1")
    client = scope.get("client") or ("",)
    return HttpRequest(scope["method"], raw_path, query, headers, b"", str(client[0]), str(uuid.uuid4()))


async def _has_left(receive: _Receive) -> bool:
    told = asyncio.ensure_future(receive())
    await asyncio.sleep(0)
    if not told.done():
        told.cancel()
        return False
    return told.result()["type"] == "http.disconnect"


async def _send_answer(send: _Send, answer: HttpAnswer, request_id: str) -> None:
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
