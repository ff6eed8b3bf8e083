"""World export as a Prefect task."""

from prefect import task
from prefect.cache_policies import NO_CACHE

from specs.pipeline_worlds import WorldFormat
from specs.world_jobs import CreateWorldExportJobRequest
from tasks.export.job import run_export_job
from tasks.storage.opening import open_store
from tasks.storage.records import JobRecord
from tasks.watching.task import watched


@task(name="export-worlds", cache_policy=NO_CACHE, persist_result=False)
def export_worlds(
    store_url: str, request: CreateWorldExportJobRequest, *, formats: tuple[WorldFormat, ...], token: str
) -> JobRecord:
    """Returns the ended export job of the token."""
    with watched("Export", "export-progress") as progress:
        return run_export_job(open_store(store_url), request, formats=formats, token=token, progress=progress)
