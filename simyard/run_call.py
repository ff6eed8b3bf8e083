"""Runs a document for a caller in Python: from a script, a thread, a running event loop, or a flow of the caller's.

All runs of this process share one Prefect server: found or started by the first, and ended after the last of them. A
thread of its own holds it: the server is bound to the thread that started it, and callers' threads may end in any
order.
"""
# ruff: noqa: PLC0415 - Prefect is imported when a run needs it, and after its server is chosen

import os
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Lock, Thread

from specs.data.run_report import PipelineReport
from specs.pipeline.document import PipelineSpec

_VARIABLES = ("PREFECT_API_URL", "PREFECT_API_AUTH_STRING", "PREFECT_HOME", "PREFECT_CLIENT_MAX_RETRIES")
_one_counts = Lock()


class Holder:
    """A thread that holds the server for as long as somebody uses it."""

    def __init__(self) -> None:
        self.users = 0
        self.variables: dict[str, str] = {}
        self._failure: BaseException | None = None
        self._ready, self._unused = Event(), Event()
        self._thread = Thread(target=self._hold, name="simyard server", daemon=True)

    def start(self) -> None:
        """Returns when there is a server.

        Raises:
            StageFailed: There is none, and none comes up.
        """
        self._thread.start()
        try:
            self._ready.wait()
        except BaseException:  # Ctrl-C, or the interrupt of a notebook
            self._unused.set()
            raise
        if self._failure:
            raise self._failure

    def end(self) -> None:
        """Returns when a server that was started has ended."""
        self._unused.set()
        self._thread.join()

    def _hold(self) -> None:
        from flows.prefect.prefect_server import prefect_server

        try:
            with prefect_server():
                self.variables = {name: os.environ[name] for name in _VARIABLES if name in os.environ}
                self._ready.set()
                self._unused.wait()
        except BaseException as exc:  # noqa: BLE001 - raised where the server is asked for
            self._failure = exc
            self._ready.set()


holders: list[Holder] = []


@contextmanager
def shared_server() -> Generator[dict[str, str], None, None]:
    """Yields the variables by which Prefect reaches the server that `simyard run` would use.

    Raises:
        StageFailed: There is none, and none comes up.
    """
    with _one_counts:
        if not holders:
            holder = Holder()
            holder.start()
            holders.append(holder)
        holder = holders[-1]
        holder.users += 1
    try:
        yield dict(holder.variables)
    finally:
        with _one_counts:
            holder.users -= 1
            if not holder.users:
                holders.remove(holder)
                holder.end()


def run_directly(spec: PipelineSpec, base: Path, store_url: str) -> PipelineReport:
    """Returns the report of the document's run, without Prefect.

    Raises:
        SimyardError: The document, the store or a stage is at fault, or it did not pass.
    """
    from flows.pipeline.pipeline import pipeline

    _prepare(spec)
    return pipeline(spec, store_url, str(base))


def run_under_prefect(spec: PipelineSpec, base: Path, store_url: str) -> PipelineReport:
    """Returns the report of the document's run, which is a flow run.

    Raises:
        SimyardError: The document, the store or a stage is at fault, or it did not pass.
    """
    _prepare(spec)
    if _is_in_flow_run():
        return _flow_report(spec, base, store_url)
    from flows.pipeline.world_imports import sources_read_once

    with sources_read_once():
        _refuse_faults(spec, base, store_url)
        with shared_server() as server:
            from flows.prefect.flow_calls import call_flow_at

            with call_flow_at(server):
                return _flow_report(spec, base, store_url)


def _prepare(spec: PipelineSpec) -> None:
    """Sets what JAX reads when it is imported, if the run is going to import it."""
    if spec.simulationBatch:
        from tasks.simulate.devices import prepare_devices

        prepare_devices()


def _flow_report(spec: PipelineSpec, base: Path, store_url: str) -> PipelineReport:
    from flows.prefect.flow_calls import canceled_as_failure
    from flows.prefect.flows import pipeline

    with canceled_as_failure():
        return pipeline(spec, store=store_url, base=str(base))


def _refuse_faults(spec: PipelineSpec, base: Path, store_url: str) -> None:
    """Refuses a document with faults before a server starts.

    Raises:
        DocumentError: It has some.
    """
    from flows.pipeline.references import resolve_references
    from tasks.storage.backends.overlay import OverlayStore
    from tasks.storage.store_url import open_store

    resolve_references(spec, OverlayStore(open_store(store_url)), base)


def _is_in_flow_run() -> bool:
    if "prefect.context" not in sys.modules:  # then nobody is, and importing it now would be before the choice
        return False
    from flows.prefect.flow_calls import is_in_flow_run

    return is_in_flow_run()
