"""World generation as a step: a plain function of data, which a process calls or Prefect runs as a task."""

from specs.robomaker.world_jobs import CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody
from tasks.progress.listener import stage_progress
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store
from tasks.worlds.job.generation_job import RemoteWorldMaker, run_generation_job
from tasks.worlds.job.production import Indices

STAGE = "Worlds"


def generate_worlds(
    store_url: str,
    request: CreateWorldGenerationJobRequest,
    template: TemplateBody,
    *,
    seed: int,
    token: str,
    robot_radius_m: float,
    first: Indices = (1, 1),
    most: int | None = None,
    remote: RemoteWorldMaker | None = None,
) -> JobRecord:
    """Returns the ended generation job of the token, having made the worlds that were missing.

    Args:
        store_url: Where worlds and records lie.
        request: What is asked for.
        template: The template that the request names.
        seed: At least 0.
        token: The client request token.
        robot_radius_m: Radius of the robot that every room shall be reachable for.
        first: Floor plan and interior of the first world.
        most: How many worlds the job may make; what this machine allows, if left out.
        remote: Workers of a cluster that make the worlds, for a caller who holds them; None for this machine.
    """
    return run_generation_job(
        open_store(store_url),
        request,
        template,
        seed=seed,
        token=token,
        progress=stage_progress(STAGE),
        robot_radius_m=robot_radius_m,
        first=first,
        most=most,
        remote=remote,
    )
