"""The Prefect task that rolls a version out."""

from collections.abc import Mapping

from prefect import task
from prefect.artifacts import create_table_artifact
from prefect.cache_policies import NO_CACHE

from specs.artifact_text import escape_markdown, table_rows
from specs.field_types import Architecture
from specs.pipeline.simulation_section import Deployment
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.deploy import step
from tasks.deploy.answers.describe import describe_deployment_job
from tasks.deploy.answers.row_summary import deployment_sentence, robot_rows
from tasks.progress.task import show_progress
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store


@task(name="roll-out", cache_policy=NO_CACHE, persist_result=False)
def roll_out(
    store_url: str,
    request: CreateDeploymentJobRequest,
    section: Deployment,
    *,
    digest: str,
    builds: Mapping[Architecture, str],
    token: str,
) -> JobRecord:
    """Returns what `tasks.deploy.step.roll_out` does, shows its progress, and leaves a table of its robots."""
    with show_progress(step.STAGE, "deployment-progress"):
        record = step.roll_out(store_url, request, section, digest=digest, builds=builds, token=token)
    job = describe_deployment_job(open_store(store_url), record.id)
    said = escape_markdown(deployment_sentence(job, record))
    rows = table_rows(robot_rows(job))
    create_table_artifact(rows, key="deployment-robots", description=said)
    return record
