"""World export, and the contact sheet of a generation job, as Prefect tasks."""

from typing import cast

from prefect import task
from prefect.artifacts import create_markdown_artifact
from prefect.cache_policies import NO_CACHE

from specs.pipeline.world_sections import WorldFormat
from specs.robomaker.world_jobs import CreateWorldExportJobRequest
from tasks.export import step
from tasks.progress.task import show_progress
from tasks.storage.jobs.records import JobRecord


@task(name="export-worlds", cache_policy=NO_CACHE, persist_result=False)
def export_worlds(
    store_url: str, request: CreateWorldExportJobRequest, *, formats: tuple[WorldFormat, ...], token: str
) -> JobRecord:
    """Returns what `tasks.export.step.export_worlds` does, and shows its progress."""
    with show_progress(step.STAGE, "export-progress"):
        return step.export_worlds(store_url, request, formats=formats, token=token)


@task(name="show-worlds", cache_policy=NO_CACHE, persist_result=False)
def draw_worlds(store_url: str, generation: JobRecord) -> str:
    """Returns what `tasks.export.step.draw_worlds` does, and leaves it on the flow run's page."""
    page = step.draw_worlds(store_url, generation)
    worlds = cast("list[str]", generation.detail["worlds"])
    create_markdown_artifact(page, key="worlds", description=f"{len(worlds)} worlds of {generation.id}")
    return page
