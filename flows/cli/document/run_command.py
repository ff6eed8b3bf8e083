"""`simyard run`: finds or starts a Prefect server, and runs the pipeline with progress bars.

The server starts while Prefect, and what the document needs, are imported, so much of its start costs no time.
"""

import logging
import os
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from flows.cli.document.progress_bars import progress_bars
from flows.document.references import pins
from flows.document.version_room import version_lines
from specs.base import Fault
from specs.data.run_report import PipelineReport
from specs.errors import DocumentError, StageFailed
from specs.pipeline.document import PipelineSpec
from specs.settings import server_wait_s
from specs.terminal_text import terminal_text
from tasks.progress.listener import listen_to_progress
from tasks.server import process
from tasks.server.collector_pause import pause_collector
from tasks.server.health import (
    is_answering,
    is_listening,
    is_local,
    proxy_exceptions,
    refuses,
    succeeds_within,
    url_without_password,
)
from tasks.server.resident import checkout_home, kept_password, kept_server
from tasks.server.watchdog import WatchdogPace, WatchdogState, guard_run
from tasks.simulate.devices import prepare_devices
from tasks.storage.backends.overlay import OverlayStore
from tasks.storage.base.cache_folder import cache_folder
from tasks.storage.store_url import open_store

_RETRIES = "PREFECT_CLIENT_MAX_RETRIES"
_OWN_WAIT_S = 20
_RESULT_BLOCK = "PREFECT_DEFAULT_RESULT_STORAGE_BLOCK"
_NO_BLOCK = "Unable to find block document"  # as Prefect 3.8 says it, by a ValueError
# What Prefect imports when the first flow and the first task begin, which the user waits for.
_LATE_IMPORTS = ("prefect.flow_engine", "prefect.task_engine", "prefect.utilities.visualization", "fastapi")
logger = logging.getLogger(__name__)


def run_document(spec: PipelineSpec, base: Path, store_url: str | None, console: Console) -> PipelineReport:
    """Returns the report of the document's run; one that was killed before is continued.

    Args:
        spec: The document.
        base: Folder that the document's relative paths start from.
        store_url: None means SIMYARD_STORE, else ``.simyard`` in the working directory.
        console: Where progress is shown.

    Raises:
        SimyardError: The document, the store or a stage is at fault.
    """
    store = open_store(store_url)
    trial = OverlayStore(store)
    pins(spec, trial, base)  # a document with faults is refused before a server starts
    for line in version_lines(spec, store, trial):
        console.print(line, markup=False, highlight=False)
    os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")  # the terminal shows progress instead
    with (
        prefect_server(lambda: _prepare_engine(spec)) as server,
        progress_bars(console) as listener,
        listen_to_progress(listener),
        _guard_server(server, console) as watch,
    ):
        from prefect.exceptions import CancelledRun  # noqa: PLC0415 - Prefect loads while the server starts

        from flows.pipeline import pipeline  # noqa: PLC0415 - same

        try:
            return pipeline(spec, store=store.url, base=str(base))
        except CancelledRun as exc:
            raise StageFailed("Canceled", str(exc)) from exc
        except ValueError as exc:
            if _NO_BLOCK not in str(exc):
                raise
            raise _block_fault() from exc
        finally:
            if not watch.gone.is_set():
                flush_prefect()


def _block_fault() -> DocumentError:
    allowed = (
        "a block of this Prefect server, made with the command of docs/operate/operations.md, Results; or not set, as "
        "for a server that runs only as long as this command"
    )
    return DocumentError([Fault(path=_RESULT_BLOCK, value=repr(os.environ.get(_RESULT_BLOCK)), allowed=allowed)])


class ServerChoice(NamedTuple):
    """The Prefect server of a run, and how many seconds it may be away."""

    api_url: str
    wait_s: int


@contextmanager
def prefect_server(prepare: Callable[[], None] = lambda: None) -> Generator[ServerChoice, None, None]:
    """Yields the server to use: the user's, the kept one, or a new one for this block, which nobody starts again.

    Args:
        prepare: Imports what the block needs; called when the server is chosen, while a new one starts.

    Raises:
        StageFailed: The server that the user chose, or the kept one, does not answer; or a new one does not come up.
    """
    home, wait_s = prefect_home(), server_wait_s()
    if given := _chosen(home) or _kept(home):
        url = given["PREFECT_API_URL"]
        with _environment(**given, **_proxy_setting(url), **_retry_setting(wait_s)):
            prepare()
            yield ServerChoice(url, wait_s)
        return
    with (
        process.run_server(home) as (server, child),
        _environment(**server.environment(), PREFECT_HOME=str(home), **_proxy_setting(server.api_url)),
    ):
        prepare()
        process.wait_until_healthy(server, child)
        yield ServerChoice(server.api_url, min(wait_s, _OWN_WAIT_S))


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


def _chosen(home: Path) -> dict[str, str]:
    """Returns the variables of the server that the user chose, which answers; none if there is no such choice."""
    chosen = process.configured(os.environ, "PREFECT_API_URL")
    if not chosen:
        return {}
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
    if not succeeds_within(lambda: is_answering(api_url)):
        remedy = "unset it, or simyard up and export what that prints"
        raise StageFailed(
            "InternalServiceError",
            f"no Prefect server answers at PREFECT_API_URL={url_without_password(api_url)}; {remedy}",
        )


def _proxy_setting(api_url: str) -> dict[str, str]:
    return proxy_exceptions(os.environ) if is_local(api_url) else {}


def _retry_setting(wait_s: int) -> dict[str, str]:
    """Returns the variable by which Prefect's client goes on asking for longer than so many seconds."""
    if _RETRIES in os.environ:
        return {}
    # The n-th pause has 2^n seconds, and up to a fifth more or less (prefect.client.base).
    retries = next(count for count in range(1, 64) if 0.8 * (2 ** (count + 1) - 2) >= wait_s)
    return {_RETRIES: str(retries)}


@contextmanager
def _guard_server(server: ServerChoice, console: Console) -> Generator[WatchdogState, None, None]:
    """Ends the run with one message and exit code 3 when the server goes away during the block."""

    def leave(failure: StageFailed) -> None:
        # Prefect holds the main thread, which cannot end the progress bars; the store is never left half written.
        console.show_cursor()
        sys.stderr.write(f"\n{terminal_text(str(failure))}\n")
        sys.stderr.flush()
        os._exit(3)

    reason = (
        f"the Prefect server at {url_without_password(server.api_url)} went away; the same command continues this run"
    )
    # Whether it listens, not how soon it answers: on a busy machine a server that is there may be silent for long.
    pace = WatchdogPace(patience_s=server.wait_s)
    with guard_run(lambda: is_listening(server.api_url), reason, leave, pace) as watch:
        yield watch


def prefect_home() -> Path:
    """Returns the folder of Simyard's own Prefect server: PREFECT_HOME, else this checkout's in the cache folder."""
    if "PREFECT_HOME" in os.environ:
        return Path(os.environ["PREFECT_HOME"])
    return checkout_home(cache_folder(), Path(process.__file__).resolve().parents[2])


def _prepare_engine(spec: PipelineSpec) -> None:
    """Imports Prefect, and what the document's sections compute with: seconds that pass while the server starts."""
    if spec.simulationBatch:
        prepare_devices()
    with pause_collector():
        for module in (*_computing_modules(spec), "flows.pipeline", *_LATE_IMPORTS):
            import_module(module)
        import_module("flows.run.heartbeats").leave_heartbeats()


def _computing_modules(spec: PipelineSpec) -> list[str]:
    """Returns what a run of the document imports that many others do not: SciPy, MuJoCo, and JAX with MJX."""
    modules: list[str] = []
    if spec.worldGeneration:
        modules.append("scipy.ndimage")
    if spec.worldExport and "mjcf" in spec.worldExport.formats:
        modules.append("tasks.export.format.mjcf")
    if spec.simulationBatch:
        modules.append("tasks.simulate.chunk.episodes")
    return modules


def flush_prefect() -> None:
    """Sends what Prefect still holds back; a server that ends with this run would not get it otherwise."""
    from prefect.events.worker import EventsWorker  # noqa: PLC0415 - only once Prefect is loaded anyway
    from prefect.logging.handlers import APILogWorker  # noqa: PLC0415

    APILogWorker.drain_all(timeout=5)
    EventsWorker.drain_all(timeout=5)


@contextmanager
def _environment(**values: str) -> Generator[None, None, None]:
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
