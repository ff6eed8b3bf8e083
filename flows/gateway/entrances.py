"""What requests meet before they are answered: signatures and rights, or the check that they come from this machine."""

from collections.abc import Callable
from pathlib import Path

from flows.gateway.calls import Page
from flows.gateway.fleet_ties import fleet_ties
from flows.gateway.page.site import Site, answer_page
from flows.gateway.serve import Entrance
from specs.arn import ArnForm
from specs.settings import actions_days, region
from tasks.gateway.access.action_log import ActionLog
from tasks.gateway.access.call_record import record_call
from tasks.gateway.access.guards import LoopbackGuard, SignedGuard
from tasks.gateway.access.key_file import KeyFile
from tasks.gateway.access.page_origin import loopback_hosts
from tasks.gateway.door import Note
from tasks.storage.base.store import Store
from tasks.storage.store_url import store_id

PrefectUrl = Callable[[], str]


def signed_entrance(store: Store, keys: Path, prefect_url: PrefectUrl = str, *, is_encrypted: bool) -> Entrance:
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
    return Entrance(guard, _page(Site(store, guard, is_encrypted, prefect_url)), _note(store))


def open_entrance(store: Store, port: int, prefect_url: PrefectUrl = str) -> Entrance:
    """Returns what lets in every program that reaches this machine's own address at a port.

    Args:
        store: What is served.
        port: Where requests come in.
        prefect_url: As for ``signed_entrance``.

    Raises:
        DocumentError: SIMYARD_ACTIONS_DAYS is no number of days.
    """
    return Entrance(
        LoopbackGuard(loopback_hosts(port)), _page(Site(store, None, prefect_url=prefect_url)), _note(store)
    )


def _page(site: Site) -> Page:
    return lambda request: answer_page(site, request)


def _note(store: Store) -> Note:
    log = ActionLog(store, actions_days())
    form = ArnForm(store_id(store), region())
    return lambda call: record_call(log, call, form.robomakers)
