"""World generation as a Prefect task."""

from prefect import task
from prefect.cache_policies import NO_CACHE

from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody
from tasks.progress.task import show_progress
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store
from tasks.worlds.job.job import RemoteWorldMaker, run_generation_job


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
    elsewhere: RemoteWorldMaker | None = None,
) -> JobRecord:
    """Returns the ended generation job of the token, having made the worlds that were missing.

    Args:
        store_url: Where worlds and records lie.
        request: What is asked for.
        template: The template that the request names.
        seed: At least 0.
        token: The client request token.
        robot_radius_m: Radius of the robot that every room shall be reachable for.
        elsewhere: Workers of a cluster that make the worlds instead, where there are any.
    """
    with show_progress("Worlds", "worlds-progress") as progress:
        return run_generation_job(
            open_store(store_url),
            request,
            template,
            seed=seed,
            token=token,
            progress=progress,
            robot_radius_m=robot_radius_m,
            elsewhere=elsewhere,
        )
