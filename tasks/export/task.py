"""World export, and the contact sheet of a generation job, as Prefect tasks."""

from collections.abc import Mapping
from typing import Any, cast

from prefect import task
from prefect.artifacts import create_markdown_artifact
from prefect.cache_policies import NO_CACHE

from specs.pipeline.world_sections import WorldFormat
from specs.robomaker.world_jobs import CreateWorldExportJobRequest
from tasks.export import step
from tasks.progress.listener import artifact_key
from tasks.progress.task import STORE_RETRY, named_by, show_progress
from tasks.storage.jobs.records import JobRecord


def export_name(parameters: Mapping[str, Any]) -> str:
    """Returns what Prefect's pages call the task run of an export, such as ``export 8 worlds``."""
    request: CreateWorldExportJobRequest = parameters["request"]
    return f"export {len(request.worlds)} world{'' if len(request.worlds) == 1 else 's'}"


@task(
    name="export-worlds",
    task_run_name=named_by(export_name),
    cache_policy=NO_CACHE,
    persist_result=False,
    **STORE_RETRY,
)
def export_worlds(
    store_url: str, request: CreateWorldExportJobRequest, *, formats: tuple[WorldFormat, ...], token: str
) -> JobRecord:
    """Returns what `tasks.export.step.export_worlds` does, and shows its progress."""
    with show_progress(step.STAGE, "export-progress"):
        return step.export_worlds(store_url, request, formats=formats, token=token)


@task(
    name="show-worlds",
    task_run_name="contact sheet",
    cache_policy=NO_CACHE,
    persist_result=False,
    **STORE_RETRY,
)
def draw_worlds(store_url: str, generation: JobRecord) -> str:
    """Returns what `tasks.export.step.draw_worlds` does, and leaves it on the flow run's page."""
    page = step.draw_worlds(store_url, generation)
    worlds = cast("list[str]", generation.detail["worlds"])
    create_markdown_artifact(page, key=artifact_key("worlds"), description=f"{len(worlds)} worlds of {generation.id}")
    return page
