"""Runs a document for a caller in Python: from a script, a thread, a running event loop, or a flow of the caller's."""
# ruff: noqa: PLC0415 - Prefect is imported when a run needs it, and after its server is chosen

import sys
from pathlib import Path

from simyard.shared_server import shared_server
from specs.data.run_report import PipelineReport
from specs.pipeline.document import PipelineSpec


def run_directly(spec: PipelineSpec, base: Path, store_url: str) -> PipelineReport:
    """Returns the report of the document's run, without Prefect.

    Raises:
        SimyardError: The document, the store or a stage is at fault, or it did not pass.
    """
    from flows.stage.pipeline_run import pipeline

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
    _refuse_faults(spec, base, store_url)
    with shared_server() as server:
        from flows.run.program_call import call_flow_at

        with call_flow_at(server):
            return _flow_report(spec, base, store_url)


def _prepare(spec: PipelineSpec) -> None:
    """Sets what JAX reads when it is imported, if the run is going to import it."""
    if spec.simulationBatch:
        from tasks.simulate.devices import prepare_devices

        prepare_devices()


def _flow_report(spec: PipelineSpec, base: Path, store_url: str) -> PipelineReport:
    from flows.pipeline import pipeline
    from flows.run.program_call import canceled_as_failure

    with canceled_as_failure():
        return pipeline(spec, store=store_url, base=str(base))


def _refuse_faults(spec: PipelineSpec, base: Path, store_url: str) -> None:
    """Refuses a document with faults before a server starts.

    Raises:
        DocumentError: It has some.
    """
    from flows.document.references import pins
    from tasks.storage.backends.overlay import OverlayStore
    from tasks.storage.store_url import open_store

    pins(spec, OverlayStore(open_store(store_url)), base)


def _is_in_flow_run() -> bool:
    if "prefect.context" not in sys.modules:  # then nobody is, and importing it now would be before the choice
        return False
    from flows.run.program_call import is_in_flow_run

    return is_in_flow_run()
