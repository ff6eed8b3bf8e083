"""World generation as a Prefect task."""

from collections.abc import Mapping
from typing import Any

from prefect import task
from prefect.cache_policies import NO_CACHE

from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody
from tasks.progress.task import STORE_RETRY, named_by, show_progress
from tasks.storage.jobs.records import JobRecord
from tasks.worlds import step
from tasks.worlds.job.production import Indices


def worlds_name(parameters: Mapping[str, Any]) -> str:
    """Returns what Prefect's pages call the task run of a generation, such as ``worlds 51-100``."""
    request: CreateWorldGenerationJobRequest = parameters["request"]
    count = (request.worldCount.floorplanCount or 1) * (request.worldCount.interiorCountPerFloorplan or 1)
    # Of several jobs, all have as many interiors of each plan or are interiors of one plan.
    plan, interior = parameters.get("first", (1, 1))
    before = (plan - 1) * (request.worldCount.interiorCountPerFloorplan or 1) + interior - 1
    return f"worlds {before + 1}-{before + count}" if count > 1 else f"world {before + 1}"


# Prefect's cache is switched off everywhere: a repeated stage is recognised by its token, in the store.
@task(
    name="generate-worlds",
    task_run_name=named_by(worlds_name),
    cache_policy=NO_CACHE,
    persist_result=False,
    **STORE_RETRY,
)
def generate_worlds(
    store_url: str,
    request: CreateWorldGenerationJobRequest,
    template: TemplateBody,
    *,
    seed: int,
    token: str,
    robot_radius_m: float,
    first: Indices = (1, 1),
) -> JobRecord:
    """Returns what `tasks.worlds.step.generate_worlds` does, and shows its progress."""
    with show_progress(step.STAGE, "worlds-progress"):
        return step.generate_worlds(
            store_url, request, template, seed=seed, token=token, robot_radius_m=robot_radius_m, first=first
        )
