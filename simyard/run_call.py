"""Runs a document for a caller in Python: from a script, a thread, a running event loop, or a flow of the caller's."""
# ruff: noqa: PLC0415 - Prefect is imported when a run needs it

import logging
import sys
from collections.abc import Generator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from threading import Thread

from simyard.shared_server import shared_server
from specs.data.run_report import PipelineReport
from specs.errors import StageFailed
from specs.pipeline.document import PipelineSpec


def run_directly(spec: PipelineSpec, base: Path, store_url: str) -> PipelineReport:
    """Returns the report of the document's run, without Prefect.

    Raises:
        SimyardError: The document, the store or a stage is at fault, or it did not pass.
    """
    from flows.stage.pipeline_run import pipeline
    from tasks.simulate.devices import prepare_devices

    if spec.simulationBatch:
        prepare_devices()
    return pipeline(spec, store_url, str(base))


def run_under_prefect(spec: PipelineSpec, base: Path, store_url: str) -> PipelineReport:
    """Returns the report of the document's run, which is a flow run.

    Raises:
        SimyardError: The document, the store or a stage is at fault, or it did not pass.
    """
    from tasks.simulate.devices import prepare_devices

    if spec.simulationBatch:
        prepare_devices()
    if _in_flow_run():
        return _flow_report(spec, base, store_url)
    _refuse_faults(spec, base, store_url)
    with shared_server() as variables, _prefect_at(variables), _silent_console():
        try:
            return _flow_report(spec, base, store_url)
        finally:
            _flush()


def _flow_report(spec: PipelineSpec, base: Path, store_url: str) -> PipelineReport:
    from prefect.exceptions import CancelledRun

    from flows.pipeline import pipeline

    try:
        return pipeline(spec, store=store_url, base=str(base))
    except CancelledRun as exc:
        raise StageFailed("Canceled", str(exc)) from exc


def _refuse_faults(spec: PipelineSpec, base: Path, store_url: str) -> None:
    """Refuses a document with faults before a server starts.

    Raises:
        DocumentError: It has some.
    """
    from flows.document.references import pins
    from tasks.storage.backends.overlay import OverlayStore
    from tasks.storage.store_url import open_store

    pins(spec, OverlayStore(open_store(store_url)), base)


def _in_flow_run() -> bool:
    """Returns whether the caller is a flow or a task of Prefect's, which has a server."""
    if "prefect.context" not in sys.modules:
        return False
    from prefect.context import FlowRunContext, TaskRunContext

    return FlowRunContext.get() is not None or TaskRunContext.get() is not None


@contextmanager
def _prefect_at(variables: dict[str, str]) -> Generator[None, None, None]:
    """Lets Prefect use a server in the block, also where Prefect was imported before there was one."""
    import_module("flows")  # sets what Prefect reads when it is imported
    settings = import_module("prefect.settings")
    with settings.temporary_settings({getattr(settings, name): value for name, value in variables.items()}):
        yield


@contextmanager
def _silent_console() -> Generator[None, None, None]:
    """Keeps what Prefect logs off the console in the block: it is on the run's page, and failures are exceptions."""
    import_module("flows.pipeline")  # which makes Prefect's handlers
    names = ("prefect", "prefect.flow_runs", "prefect.task_runs", "prefect.server", "prefect.client")
    handlers = {each for name in names for each in logging.getLogger(name).handlers if "Console" in type(each).__name__}
    before = {handler: handler.level for handler in handlers}
    for handler in handlers:
        handler.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for handler, level in before.items():
            handler.setLevel(level)


def _flush() -> None:
    """Sends what Prefect still holds back, in a thread: where an event loop runs, Prefect would return an awaitable."""
    from flows.cli.document.run_command import flush_prefect

    thread = Thread(target=flush_prefect, name="simyard flush")
    thread.start()
    thread.join()
