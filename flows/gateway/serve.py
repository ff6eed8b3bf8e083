"""Serves a store until the process is told to stop."""

import ssl
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, cast

import uvicorn

from flows.gateway.application import Application
from flows.gateway.calls import Calls, Page
from flows.gateway.gateway import Gateway
from flows.gateway.handlers import HANDLERS
from tasks.gateway.connection.bound_socket import bound_socket
from tasks.gateway.connection.bounded_protocol import BoundedProtocol
from tasks.gateway.connection.connections import Bounds, Connections
from tasks.gateway.door import Guard, Note
from tasks.storage.base.store import Store

_MOST_HEAD_BYTES = 16 << 10


class Listener(NamedTuple):
    """Where requests are awaited.

    Attributes:
        host: The address.
        port: Its port.
        tls: How connections are encrypted; None if they are not.
        bounds: What connections may take.
    """

    host: str
    port: int
    tls: ssl.SSLContext | None = None
    bounds: Bounds = Bounds()


class Entrance(NamedTuple):
    """What a request meets.

    Attributes:
        guard: Who lets it in.
        page: What answers a browser.
        note: Keeps a line about it.
    """

    guard: Guard
    page: Page
    note: Note


def serve(store: Store, entrance: Entrance, listener: Listener, wake: Callable[[], None]) -> None:
    """Answers requests until a signal ends it; those that have begun are answered first.

    Args:
        store: What is served.
        entrance: What requests meet.
        listener: Where they come from.
        wake: Tells the workers of this machine that the queue has something new.

    Raises:
        DocumentError: Another program listens there.
    """
    gateway = Gateway(store, wake)
    application = Application(Calls(gateway, HANDLERS, *entrance))
    protocol = partial(BoundedProtocol, all_connections=Connections(listener.bounds), tls=listener.tls)
    config = uvicorn.Config(
        application,
        http=cast("Any", protocol),
        ws="none",
        loop="asyncio",
        h11_max_incomplete_event_size=_MOST_HEAD_BYTES,
        timeout_keep_alive=int(listener.bounds.idle_s),
        proxy_headers=False,  # whoever may say where it comes from could say anything
        log_config=None,
        log_level="error",  # what is no HTTP is a line for each attempt otherwise
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=10,
    )
    with bound_socket(listener.host, listener.port) as bound:
        uvicorn.Server(config).run([bound])
