"""`simyard run --direct`: runs the same stages as plain functions, without Prefect.

What needs a server is lost: pages, artifacts, events, automations, workers of a cluster, and Prefect's cancellation.
The store has the same records and files, so that either way continues what the other began.
"""

from pathlib import Path

from rich.console import Console

from flows.cli.document.progress_bars import progress_bars
from flows.document.output_buckets import new_bucket_lines
from flows.stage.pipeline_run import pipeline
from specs.data.run_report import PipelineReport
from specs.pipeline.document import PipelineSpec
from tasks.progress.listener import listen_to_progress
from tasks.simulate.devices import prepare_devices
from tasks.storage.store_url import open_store


def run_directly(spec: PipelineSpec, base: Path, store_url: str | None, console: Console) -> PipelineReport:
    """Returns the report of the document's run; one that was killed before is continued.

    Args:
        spec: The document.
        base: Folder that the document's relative paths start from.
        store_url: None means SIMYARD_STORE, else ``.simyard`` in the working directory.
        console: Where progress is shown.

    Raises:
        SimyardError: The document, the store or a stage is at fault.
    """
    for line in new_bucket_lines(spec, open_store(store_url)):
        console.print(line, markup=False, highlight=False)
    prepare_devices()
    with progress_bars(console) as listener, listen_to_progress(listener):
        return pipeline(spec, store_url, str(base))
