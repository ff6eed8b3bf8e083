"""Serves a store until the process is told to stop."""

from collections.abc import Callable
from typing import NamedTuple

import uvicorn

from flows.gateway.application import Application
from flows.gateway.calls import Calls
from flows.gateway.gateway import Gateway
from flows.gateway.handlers import HANDLERS
from tasks.gateway.door import Guard
from tasks.storage.base.store import Store


class Listener(NamedTuple):
    """Where requests are awaited."""

    host: str
    port: int


def serve(store: Store, guard: Guard, listener: Listener, wake: Callable[[], None]) -> None:
    """Answers requests until a signal ends it; those that have begun are answered first.

    Args:
        store: What is served.
        guard: Who lets requests in.
        listener: Where they come from.
        wake: Tells the workers of this machine that the queue has something new.
    """
    gateway = Gateway(store, wake)
    application = Application(Calls(gateway, HANDLERS, guard))
    config = uvicorn.Config(
        application,
        host=listener.host,
        port=listener.port,
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=10,
    )
    uvicorn.Server(config).run()
