"""World generation as a Prefect task."""

from prefect import task
from prefect.cache_policies import NO_CACHE

from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody
from tasks.progress.task import show_progress
from tasks.storage.jobs.records import JobRecord
from tasks.worlds import step


# Prefect's cache is switched off everywhere: a repeated stage is recognised by its token, in the store.
@task(name="generate-worlds", cache_policy=NO_CACHE, persist_result=False)
def generate_worlds(
    store_url: str,
    request: CreateWorldGenerationJobRequest,
    template: TemplateBody,
    *,
    seed: int,
    token: str,
    robot_radius_m: float,
) -> JobRecord:
    """Returns what `tasks.worlds.step.generate_worlds` does, and shows its progress."""
    with show_progress(step.STAGE, "worlds-progress"):
        return step.generate_worlds(store_url, request, template, seed=seed, token=token, robot_radius_m=robot_radius_m)
