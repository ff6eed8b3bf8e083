"""A botocore client of RoboMaker whose requests are answered in this process, by the ASGI application."""

import asyncio
import json
from collections.abc import Callable, Generator, Mapping, MutableMapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode, urlsplit

import botocore.loaders
import botocore.session
from botocore.awsrequest import AWSPreparedRequest, AWSResponse
from botocore.config import Config

from flows.gateway.application import Application, Calls, Page, no_page
from flows.gateway.gateway import Gateway, Handlers
from flows.gateway.handlers import HANDLERS
from specs.robomaker.operations import Operation, location
from tasks.gateway.access.guard import Guard, LoopbackGuard, loopback_hosts
from tasks.gateway.rest_json import HttpAnswer
from tasks.gateway.service_model import write_model
from tasks.storage.base.store import Store

HOST = "127.0.0.1:8600"
Send = Callable[..., HttpAnswer]
"""Sends method, path with query, body, headers; returns the answer."""


@contextmanager
def running_application(
    store: Store, handlers: Handlers = HANDLERS, guard: Guard | None = None, page: Page = no_page
) -> Generator[Send]:
    """Yields a function that sends a request through the ASGI application of a store."""
    calls = Calls(Gateway(store, lambda: None), handlers, guard or LoopbackGuard(loopback_hosts(8600)), page)
    application = Application(calls, threads=2)
    with asyncio.Runner() as runner:

        def send(
            method: str, target: str, body: bytes = b"", headers: tuple[tuple[str, str], ...] = (("host", HOST),)
        ) -> HttpAnswer:
            return runner.run(_answer(application, method, target, body, headers))

        yield send


def client_of(send: Send, models: Path, **settings: Any) -> Any:  # noqa: ANN401 - botocore has no types
    """Returns a client, as boto3 makes it, that sends by a function and finds the model that Simyard writes.

    Args:
        send: Sends a request.
        models: A folder for the model.
        settings: Of botocore's Config.
    """
    write_model(models)
    session = botocore.session.Session()
    session.set_credentials("key", "secret")
    session.register_component("data_loader", botocore.loaders.Loader(extra_search_paths=[str(models)]))
    config = Config(retries={"total_max_attempts": 1}, **settings)
    client = session.create_client("robomaker", "us-west-2", endpoint_url=f"http://{HOST}", config=config)
    client.meta.events.register("before-send", lambda request, **_: _response(send, request))
    return client


def request_of(operation: Operation, members: Mapping[str, Any]) -> tuple[str, str, bytes]:
    """Returns method, target and body of a request, as an SDK would write them."""
    places = {name: location(operation, name) for name in members}
    path = operation.path
    for name in members:
        path = path.replace(f"{{{name}}}", quote(str(members[name]), safe=""))
    query = {name: members[name] for name, place in places.items() if place == "querystring"}
    target = f"{path}?{urlencode(query, doseq=True)}" if query else path
    body = {name: value for name, value in members.items() if places[name] == "body"}
    return operation.method, target, json.dumps(body).encode()


def _response(send: Send, request: AWSPreparedRequest) -> AWSResponse:
    parts = urlsplit(request.url)
    target = f"{parts.path}?{parts.query}" if parts.query else parts.path
    headers = tuple((str(name), _text(value)) for name, value in request.headers.items())
    answer = send(request.method, target, _bytes(request.body), (*headers, ("host", HOST)))
    told = {"content-type": answer.content_type, **answer.headers}
    return AWSResponse(request.url, answer.status, told, _Raw(answer.body))


class _Raw:
    """As much of urllib3's response as botocore reads."""

    def __init__(self, body: bytes) -> None:
        self._body = body

    def stream(self, *_: object, **__: object) -> list[bytes]:
        return [self._body]


def _bytes(body: object) -> bytes:
    return body if isinstance(body, bytes) else str(body or "").encode()


def _text(value: object) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


async def _answer(
    application: Application, method: str, target: str, body: bytes, headers: tuple[tuple[str, str], ...]
) -> HttpAnswer:
    path, _, query = target.partition("?")
    scope = {
        "type": "http",
        "method": method,
        "raw_path": path.encode("latin-1"),
        "path": path,
        "query_string": query.encode("latin-1"),
        "headers": [(name.lower().encode(), value.encode("latin-1")) for name, value in headers],
        "client": ("127.0.0.1", 1),
    }
    sent: list[Any] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": body, "more_body": False}

    async def send(message: MutableMapping[str, Any]) -> None:
        sent.append(message)

    await application(scope, receive, send)
    told = {name.decode(): value.decode() for name, value in sent[0]["headers"]}
    content_type, error = told.get("content-type", ""), told.get("x-amzn-errortype", "")
    return HttpAnswer(sent[0]["status"], sent[1]["body"], content_type, error, told)
