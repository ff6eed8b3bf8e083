"""Serves a store until the process is told to stop."""

import ssl
from functools import partial
from typing import Any, NamedTuple, cast

import uvicorn

from flows.gateway.application import Application
from flows.gateway.calls import Calls, Page, no_page
from flows.gateway.gateway import Gateway
from flows.gateway.handlers import HANDLERS
from flows.gateway.page.site import Site, answer_page
from flows.server.prefect_server import pages_url
from tasks.gateway.access.guards import LoopbackGuard, SignedGuard
from tasks.gateway.access.page_origin import is_loopback
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


def serve(store: Store, guard: Guard, note: Note, listener: Listener) -> None:
    """Answers requests until a signal ends it; those that have begun are answered first.

    Args:
        store: What is served.
        guard: Who lets requests in.
        note: Keeps a line about each call.
        listener: Where they come from.
    """
    gateway = Gateway(store, lambda: None)
    application = Application(Calls(gateway, HANDLERS, guard, _pages(store, guard, listener), note))
    protocol = partial(BoundedProtocol, all_connections=Connections(listener.bounds), tls=listener.tls)
    config = uvicorn.Config(
        application,
        http=cast("Any", protocol),
        ws="none",
        loop="asyncio",
        h11_max_incomplete_event_size=_MOST_HEAD_BYTES,
        timeout_keep_alive=int(listener.bounds.idle_s),
        proxy_headers=False,  # whoever may say where it comes from could say anything
        host=listener.host,
        port=listener.port,
        log_config=None,
        log_level="error",  # what is no HTTP is a line for each attempt otherwise
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=10,
    )
    uvicorn.Server(config).run()


def _pages(store: Store, guard: Guard, listener: Listener) -> Page:
    """Returns what answers browsers: who signs in with a key, or everybody whom a guard without keys lets in."""
    # Beyond this machine something encrypts, if not this process; the cookie goes nowhere without that.
    is_secure = listener.tls is not None or not is_loopback(listener.host)
    match guard:
        case SignedGuard():
            return partial(answer_page, Site(store, guard, is_secure, pages_url))
        case LoopbackGuard():
            return partial(answer_page, Site(store, None, is_secure, pages_url))
        case _:
            return no_page
