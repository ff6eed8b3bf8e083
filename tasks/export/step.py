"""World export, and the contact sheet of a generation job, as steps: plain functions of data."""

from collections.abc import Mapping
from typing import cast

from pydantic import JsonValue

from specs.pipeline.world_sections import WorldFormat
from specs.robomaker.world_jobs import CreateWorldExportJobRequest
from tasks.export.job.job import ExportWorkers, run_export_job
from tasks.export.job.sheet_job import keep_contact_sheet, sheet_markdown
from tasks.progress.listener import stage_progress
from tasks.storage.base.keys import contact_sheet_key
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store

STAGE = "Export"


def export_worlds(
    store_url: str, request: CreateWorldExportJobRequest, *, formats: tuple[WorldFormat, ...], token: str
) -> JobRecord:
    """Returns the ended export job of the token.

    Args:
        store_url: Where worlds and records lie.
        request: RoboMaker's request.
        formats: What each world is written as.
        token: The client request token.
    """
    return export_elsewhere(store_url, request, formats=formats, token=token, elsewhere=None)


def export_elsewhere(
    store_url: str,
    request: CreateWorldExportJobRequest,
    *,
    formats: tuple[WorldFormat, ...],
    token: str,
    elsewhere: ExportWorkers | None,
) -> JobRecord:
    """Returns what `export_worlds` does, for which workers of a cluster write the worlds; for who holds them."""
    store, progress = open_store(store_url), stage_progress(STAGE)
    return run_export_job(store, request, formats=formats, token=token, progress=progress, elsewhere=elsewhere)


def draw_worlds(store_url: str, generation: JobRecord) -> str:
    """Returns a page, as Markdown, with the worlds of a generation job side by side; keeps their picture."""
    store = open_store(store_url)
    worlds = cast("list[str]", generation.detail["worlds"])
    failures = cast("Mapping[str, Mapping[str, JsonValue]]", generation.detail["failures"])
    sheet = keep_contact_sheet(store, generation.id, worlds)
    return sheet_markdown(sheet, f"{store.url}/{contact_sheet_key(generation.id)}", failures)
