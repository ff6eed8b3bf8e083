"""World export, and the contact sheet of a generation job, as Prefect tasks."""

from collections.abc import Mapping
from typing import cast

from prefect import task
from prefect.artifacts import create_markdown_artifact
from prefect.cache_policies import NO_CACHE
from pydantic import JsonValue

from specs.pipeline.world_sections import WorldFormat
from specs.robomaker.world_jobs import CreateWorldExportJobRequest
from tasks.export.job.job import ExportWorkers, run_export_job
from tasks.export.job.sheet_job import keep_contact_sheet, sheet_markdown
from tasks.progress.task import show_progress
from tasks.storage.base.keys import contact_sheet_key
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store


@task(name="export-worlds", cache_policy=NO_CACHE, persist_result=False)
def export_worlds(
    store_url: str,
    request: CreateWorldExportJobRequest,
    *,
    formats: tuple[WorldFormat, ...],
    token: str,
    elsewhere: ExportWorkers | None = None,
) -> JobRecord:
    """Returns the ended export job of the token.

    Args:
        store_url: Where worlds and records lie.
        request: RoboMaker's request.
        formats: What each world is written as.
        token: The client request token.
        elsewhere: Workers that write worlds, where there are any.
    """
    with show_progress("Export", "export-progress") as progress:
        store = open_store(store_url)
        return run_export_job(store, request, formats=formats, token=token, progress=progress, elsewhere=elsewhere)


@task(name="show-worlds", cache_policy=NO_CACHE, persist_result=False)
def show_worlds(store_url: str, generation: JobRecord) -> None:
    """Shows the worlds of a generation job that made some, side by side, on the flow run's page."""
    store = open_store(store_url)
    worlds = cast("list[str]", generation.detail["worlds"])
    failures = cast("Mapping[str, Mapping[str, JsonValue]]", generation.detail["failures"])
    sheet = keep_contact_sheet(store, generation.id, worlds)
    page = sheet_markdown(sheet, f"{store.url}/{contact_sheet_key(generation.id)}", failures)
    create_markdown_artifact(page, key="worlds", description=f"{len(worlds)} worlds of {generation.id}")
