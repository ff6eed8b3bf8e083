"""The Prefect server of a run: the user's, the kept one, or a new one that ends with the run. It imports no Prefect."""

import logging
import os
import sys
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import NamedTuple
from urllib.parse import urlsplit

from specs.base import Fault
from specs.errors import DocumentError, StageFailed
from specs.settings import SERVER_WAIT
from tasks.progress.log_lines import log_duration
from tasks.server import process
from tasks.server.health import (
    accepts,
    is_answering,
    is_listening,
    refuses,
    speaks_prefect,
    succeeds_within,
    url_without_password,
)
from tasks.server.resident import checkout_home, is_kept_elsewhere, kept_password, kept_process, kept_server
from tasks.storage.base.local_files import cache_folder
from tasks.storage.base.proxies import is_local, proxy_exceptions, useless_proxies

_DRAIN_S = 5.0
_SENDERS = ("prefect.events.worker", "prefect.logging.handlers")


def flush_prefect() -> None:
    """Sends what Prefect still holds back, within ten seconds; a server that ends now would not get it otherwise.

    Prefect would try for a minute at the process's end, in vain. Where nothing has been imported that holds something
    back, nothing is imported for it either.
    """
    if not any(module in sys.modules for module in _SENDERS):
        return
    # Where an event loop runs, Prefect would return an awaitable.
    thread = Thread(target=_drain, name="simyard flush")
    thread.start()
    thread.join()


def _drain() -> None:
    from prefect.events.worker import EventsWorker  # noqa: PLC0415 - a caller may never have imported Prefect
    from prefect.logging.handlers import APILogWorker  # noqa: PLC0415 - likewise

    APILogWorker.drain_all(timeout=_DRAIN_S)
    EventsWorker.drain_all(timeout=_DRAIN_S)


_RETRIES = "PREFECT_CLIENT_MAX_RETRIES"
_OWN_WAIT_S = 20
_BUSY_S = 30.0
_SAID_CHARACTERS = 300
# Those that this process has set itself.
_OWN_VARIABLES = (
    "PREFECT_API_URL",
    "PREFECT_API_AUTH_STRING",
    "PREFECT_HOME",
    "PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL",
)
_LOOK_S = 0.5
logger = logging.getLogger(__name__)


class ServerChoice(NamedTuple):
    """The Prefect server of a run, and how many seconds it may be away."""

    api_url: str
    wait_s: int


@contextmanager
def prefect_server(prepare: Callable[[], None] = lambda: None) -> Generator[ServerChoice, None, None]:
    """Yields the server to use: the user's, the kept one, or a new one for this block, which nobody starts again.

    When the block ends, however it does, what Prefect still holds back is sent to the server, if that is there.

    Args:
        prepare: Imports what the block needs; called when the server is chosen, while a new one starts.

    Raises:
        StageFailed: The server that the user chose, or the kept one, does not answer; or a new one does not come up.
    """
    home, wait_s = prefect_home(), SERVER_WAIT.value()
    if given := _chosen(home) or _kept(home):
        url = given["PREFECT_API_URL"]
        with _environment(**given, **_proxy_setting(url), **_retry_setting(wait_s)):
            require_prefect_settings()
            prepare()
            with _flushed(url):
                yield ServerChoice(url, wait_s)
        return
    begins = "wait_for_server" if process.has_database(home) else "make_server_database"
    with (
        process.run_server(home) as (server, child),
        _environment(**server.environment(), PREFECT_HOME=str(home), **_proxy_setting(server.api_url)),
    ):
        with log_duration("prepare"):
            require_prefect_settings()
            prepare()
        with log_duration(begins):
            process.wait_until_healthy(server, child)
        with _flushed(server.api_url):
            yield ServerChoice(server.api_url, min(wait_s, _OWN_WAIT_S))


def require_prefect_settings() -> None:
    """Has Prefect read its settings, and make a client and a serializer by them, before anything else can be at fault.

    Raises:
        DocumentError: It does not take one of them; all that are set are named.
    """
    try:
        _read_settings()
    except Exception as exc:  # pydantic's, OSErrors, TypeErrors of logging; nothing of Simyard's ran
        own = (*process.SERVER_ENVIRONMENT, *_OWN_VARIABLES)
        names = sorted(name for name in os.environ if name.startswith("PREFECT_") and name not in own)
        said = " ".join(f"{type(exc).__name__}: {exc}".split())[:_SAID_CHARACTERS]
        allowed = f"what this Prefect takes; it says: {said}"
        raise DocumentError.of("environment", ", ".join(names) or "as Prefect is installed here", allowed) from exc


def _read_settings() -> None:
    import_module("prefect.main")  # it reads them when it is imported
    from prefect.client.orchestration import get_client  # noqa: PLC0415 - same
    from prefect.serializers import Serializer  # noqa: PLC0415 - same
    from prefect.settings import PREFECT_API_URL, get_current_settings, temporary_settings  # noqa: PLC0415 - same

    results = get_current_settings().results
    Serializer(type=results.default_serializer)
    if results.default_storage_block and results.default_storage_block.count("/") != 1:
        raise ValueError(f"a block of results is KIND/NAME, and not {results.default_storage_block!r}")
    # Where Prefect was imported before, it does not know the server yet, and would start one of its own for the client.
    with temporary_settings({PREFECT_API_URL: url} if (url := os.environ.get("PREFECT_API_URL")) else None):
        get_client(sync_client=True)


@contextmanager
def server_in_reserve() -> Generator[None, None, None]:
    """Lets a new server for the block import what it needs, where none is chosen and none is kept; returns at once.

    ``prefect_server`` calls it up, once the document is found to have no faults.
    """
    os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")  # the terminal shows progress instead
    home = prefect_home()
    if process.configured(os.environ, "PREFECT_API_URL") or kept_process(home) or is_kept_elsewhere(home):
        yield
        return
    with process.reserve_server(home):
        yield


@contextmanager
def known_server() -> Generator[str, None, None]:
    """Yields the URL of the server that the user chose, or of the kept one; empty if none of them answers."""
    home = prefect_home()
    try:
        given = _chosen(home) or _kept(home)
    except StageFailed as exc:
        logger.warning("%s", exc)
        given = {}
    url = given.get("PREFECT_API_URL", "")
    with _environment(**given, **_proxy_setting(url)):
        yield url


def pages_url() -> str:
    """Returns where the pages of the Prefect server are, the user's or the kept one; empty if none is known."""
    url = process.configured(os.environ, "PREFECT_API_URL")
    if not url:
        with suppress(StageFailed):  # it is silent: it has no pages now
            kept = kept_server(prefect_home(), _LOOK_S)
            url = kept.api_url if kept else ""
    parts = urlsplit(url)
    host = parts.netloc.rpartition("@")[2]  # before it stand a name and a password
    path = parts.path.rstrip("/").removesuffix("/api")
    return f"{parts.scheme}://{host}{path}" if parts.scheme in {"http", "https"} and host else ""


def _chosen(home: Path) -> dict[str, str]:
    """Returns the variables of the server that the user chose, which answers; none if there is no such choice."""
    chosen = process.configured(os.environ, "PREFECT_API_URL")
    if not chosen:
        return {}
    if not is_local(chosen) and (useless := useless_proxies(os.environ)):
        allowed = "a proxy that Prefect's client can use: http://host:port, or SOCKS with pip install 'httpx[socks]'"
        named = [
            Fault(path=f"environment variable {each}", value=repr(os.environ[each]), allowed=allowed)
            for each in useless
        ]
        raise DocumentError(named)
    password = process.configured(os.environ, "PREFECT_API_AUTH_STRING") or kept_password(home, chosen)
    _require(chosen, password)
    return {"PREFECT_API_URL": chosen, **({"PREFECT_API_AUTH_STRING": password} if password else {})}


def _kept(home: Path) -> dict[str, str]:
    kept = kept_server(home)
    return kept.environment() if kept else {}


def _require(api_url: str, password: str) -> None:
    if is_local(api_url) and refuses(api_url, password):
        raise StageFailed(
            "InternalServiceError",
            f"the Prefect server at {url_without_password(api_url)} refuses its password, or has been given none; set "
            "PREFECT_API_AUTH_STRING, as simyard up prints it",
        )
    remedy = "unset it, or simyard up and export what that prints"
    if not (succeeds_within(lambda: is_answering(api_url)) or _answers_late(api_url)):
        raise StageFailed(
            "InternalServiceError",
            f"no Prefect server answers at PREFECT_API_URL={url_without_password(api_url)}; {remedy}",
        )
    if not speaks_prefect(api_url):
        raise StageFailed(
            "InternalServiceError",
            f"what answers at PREFECT_API_URL={url_without_password(api_url)} is no API of Prefect's: its address ends "
            f"with /api, as http://127.0.0.1:4200/api does; {remedy}",
        )


def _answers_late(api_url: str) -> bool:
    """Returns whether a server that takes connections and says nothing answers after all: it is busy."""
    with suppress(TimeoutError):
        return accepts(api_url) and succeeds_within(lambda: is_answering(api_url), _BUSY_S)
    return False


def _proxy_setting(api_url: str) -> dict[str, str | None]:
    """Returns the variables by which Prefect's client reaches a server past proxies; None for one that is unset."""
    if not is_local(api_url):
        return {}
    return {**dict.fromkeys(useless_proxies(os.environ)), **proxy_exceptions(os.environ)}


def _retry_setting(wait_s: int) -> dict[str, str]:
    """Returns the variable by which Prefect's client goes on asking for longer than so many seconds."""
    if _RETRIES in os.environ:
        return {}
    # The n-th pause has 2^n seconds, and up to a fifth more or less (prefect.client.base).
    retries = next(count for count in range(1, 64) if 0.8 * (2 ** (count + 1) - 2) >= wait_s)
    return {_RETRIES: str(retries)}


def prefect_home() -> Path:
    """Returns the folder of Simyard's own Prefect server: PREFECT_HOME, else this checkout's in the cache folder."""
    if "PREFECT_HOME" in os.environ:
        return Path(os.environ["PREFECT_HOME"])
    return checkout_home(cache_folder(), Path(process.__file__).resolve().parents[2])


@contextmanager
def _flushed(api_url: str) -> Generator[None, None, None]:
    try:
        yield
    finally:
        if is_listening(api_url):
            flush_prefect()


@contextmanager
def _environment(**values: str | None) -> Generator[None, None, None]:
    before = {name: os.environ.get(name) for name in values}
    _set_variables(values)
    try:
        yield
    finally:
        _set_variables(before)


def _set_variables(values: Mapping[str, str | None]) -> None:
    for name, value in values.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
