"""`simyard run`: finds or starts a Prefect server, and runs the pipeline with progress bars.

The server starts while Prefect, and what the document needs, are imported, so much of its start costs no time.
"""

import logging
import os
import sys
from collections.abc import Generator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

from rich.console import Console

from flows.cli.document.progress_bars import progress_bars
from flows.document.output_buckets import new_bucket_lines
from flows.document.references import pins
from flows.document.version_room import version_lines
from flows.server.prefect_server import ServerChoice, prefect_server
from specs.base import Fault
from specs.data.run_report import PipelineReport
from specs.errors import DocumentError, StageFailed
from specs.pipeline.document import PipelineSpec
from specs.terminal_text import terminal_text
from tasks.progress.listener import listen_to_progress
from tasks.server.collector_pause import pause_collector
from tasks.server.health import is_listening, url_without_password
from tasks.server.watchdog import WatchdogPace, WatchdogState, guard_run
from tasks.simulate.devices import prepare_devices
from tasks.storage.backends.overlay import OverlayStore
from tasks.storage.store_url import open_store

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
    for line in (*version_lines(spec, store, trial), *new_bucket_lines(spec, store)):
        console.print(line, markup=False, highlight=False)
    os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")  # the terminal shows progress instead
    with (
        prefect_server(lambda: _prepare_engine(spec)) as server,
        progress_bars(console) as listener,
        listen_to_progress(listener),
        _guard_server(server, console),
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


def _block_fault() -> DocumentError:
    allowed = (
        "a block of this Prefect server, made with the command of docs/operate/operations.md, Results; or not set, as "
        "for a server that runs only as long as this command"
    )
    return DocumentError([Fault(path=_RESULT_BLOCK, value=repr(os.environ.get(_RESULT_BLOCK)), allowed=allowed)])


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
        f"the Prefect server at {url_without_password(server.api_url)} went away; "
        "the same command continues this run if the document is unchanged"
    )
    # Whether it listens, not how soon it answers: on a busy machine a server that is there may be silent for long.
    pace = WatchdogPace(patience_s=server.wait_s)
    with guard_run(lambda: is_listening(server.api_url), reason, leave, pace) as watch:
        yield watch


def _prepare_engine(spec: PipelineSpec) -> None:
    """Imports Prefect, and what the document's sections compute with: seconds that pass while the server starts."""
    if spec.simulationBatch:
        prepare_devices()
    with pause_collector():
        for module in (*_computing_modules(spec), "flows.pipeline", *_LATE_IMPORTS):
            import_module(module)
        import_module("flows.run.heartbeats").leave_heartbeats()


def _computing_modules(spec: PipelineSpec) -> list[str]:
    """Returns what a run of the document imports that many others do not: SciPy and MuJoCo.

    JAX is none of it: only the process that simulates imports that, see
    ``flows.stage.batch_stage.begin_simulation_process``.
    """
    modules: list[str] = []
    if spec.worldGeneration:
        modules.append("scipy.ndimage")
    if spec.worldExport and "mjcf" in spec.worldExport.formats:
        modules.append("tasks.export.format.mjcf")
    return modules
