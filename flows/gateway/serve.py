"""Serves a store until the process is told to stop.

Requests meet signatures and rights before they are answered, or the check that they come from this machine.
"""

import ssl
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import uvicorn

from flows.gateway.application import Application, Calls, Page, Reader, no_reader
from flows.gateway.gateway import Gateway
from flows.gateway.handlers import HANDLERS
from flows.gateway.page.site import Site, answer_page, reader_of
from specs.arn import ArnForm, ResourceKind, reference_path
from specs.errors import DocumentError
from specs.settings import ACTIONS_DAYS, region
from tasks.deploy.fleet.fleet_registry import known_robot
from tasks.gateway.access.access_keys import KeyFile
from tasks.gateway.access.action_log import ActionLog, record_call
from tasks.gateway.access.guard import Guard, LoopbackGuard, Note, SignedGuard, loopback_hosts
from tasks.gateway.access.rights import FleetOf
from tasks.gateway.connections import BoundedProtocol, Bounds, Connections, bound_socket
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import read
from tasks.storage.store_url import store_id

_MOST_HEAD_BYTES = 16 << 10
PrefectUrl = Callable[[], str]


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


class Auth(NamedTuple):
    """What a request meets.

    Attributes:
        guard: Who lets it in.
        page: What answers a browser.
        note: Keeps a line about it.
        reader: Says whose browser asks.
    """

    guard: Guard
    page: Page
    note: Note
    reader: Reader = no_reader


def serve(store: Store, auth: Auth, listener: Listener, wake: Callable[[], None]) -> None:
    """Answers requests until a signal ends it; those that have begun are answered first.

    Args:
        store: What is served.
        auth: What requests meet.
        listener: Where they come from.
        wake: Tells the workers of this machine that the queue has something new.

    Raises:
        DocumentError: Another program listens there.
    """
    gateway = Gateway(store, wake)
    application = Application(Calls(gateway, HANDLERS, *auth[:-1], reader=auth.reader))
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


def fleet_ties(store: Store) -> FleetOf:
    """Returns a function that says which fleet of a store a robot is in, or a deployment is of."""

    def fleet_of(kind: ResourceKind, path: str) -> str:
        try:
            if kind == "robot":
                robot = known_robot(store, path)
                return robot.fleet if robot else ""
            return reference_path(str(read(store, "deployment-job", path).request.get("fleet", "")))
        except DocumentError:  # nothing is called so
            return ""

    return fleet_of


def signed_auth(store: Store, keys: Path, prefect_url: PrefectUrl = str, *, is_encrypted: bool) -> Auth:
    """Returns what lets in who signs with a key of a file, for what that key may do.

    Args:
        store: What is served.
        keys: The file.
        prefect_url: Says where the pages of the Prefect server are; empty if none is known.
        is_encrypted: Whether clients come by TLS, of this process or of a proxy in front of it.

    Raises:
        DocumentError: SIMYARD_ACTIONS_DAYS is no number of days.
    """
    guard = SignedGuard(KeyFile(keys), store_id(store), fleet_ties(store))
    site = Site(store, guard, is_encrypted, prefect_url)
    return Auth(guard, _page(site), _note(store), partial(reader_of, site))


def loopback_auth(store: Store, port: int, prefect_url: PrefectUrl = str) -> Auth:
    """Returns what lets in every program that reaches this machine's own address at a port.

    Args:
        store: What is served.
        port: Where requests come in.
        prefect_url: As for ``signed_auth``.

    Raises:
        DocumentError: SIMYARD_ACTIONS_DAYS is no number of days.
    """
    return Auth(LoopbackGuard(loopback_hosts(port)), _page(Site(store, None, prefect_url=prefect_url)), _note(store))


def _page(site: Site) -> Page:
    return lambda request: answer_page(site, request)


def _note(store: Store) -> Note:
    log = ActionLog(store, ACTIONS_DAYS.value())
    form = ArnForm(store_id(store), region())
    return lambda call: record_call(log, call, form.robomakers)
