"""The Prefect task that rolls a version out."""

from collections.abc import Mapping
from typing import Any

from prefect import task
from prefect.artifacts import create_table_artifact
from prefect.cache_policies import NO_CACHE

from specs.arn import resource_name
from specs.field_types import Architecture
from specs.pipeline.simulation_section import Deployment
from specs.robomaker.deployment import CreateDeploymentJobRequest
from specs.untrusted_text import escape_markdown, table_rows
from tasks.deploy import step
from tasks.deploy.fleet_descriptions import deployment_sentence, describe_deployment_job, robot_rows
from tasks.progress.listener import artifact_key
from tasks.progress.task import STORE_RETRY, named_by, show_progress
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store


def roll_out_name(parameters: Mapping[str, Any]) -> str:
    """Returns what Prefect's pages call the task run of a roll-out, such as ``roll out to couriers``."""
    request: CreateDeploymentJobRequest = parameters["request"]
    return f"roll out to {resource_name(request.fleet)}"


def sync_name(parameters: Mapping[str, Any]) -> str:
    """Returns what Prefect's pages call the task run of a sync, such as ``sync couriers``."""
    return f"sync {resource_name(parameters['fleet'])}"


@task(
    name="roll-out",
    task_run_name=named_by(roll_out_name),
    cache_policy=NO_CACHE,
    persist_result=False,
    **STORE_RETRY,
)
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
    _show_robots(store_url, record)
    return record


@task(
    name="deploy-version",
    task_run_name=named_by(roll_out_name),
    cache_policy=NO_CACHE,
    persist_result=False,
    **STORE_RETRY,
)
def deploy_version(store_url: str, request: CreateDeploymentJobRequest, *, digest: str, token: str) -> JobRecord:
    """Returns what `tasks.deploy.step.deploy_version` does, shows its progress, and leaves a table of its robots."""
    with show_progress(step.STAGE, "deployment-progress"):
        record = step.deploy_version(store_url, request, digest=digest, token=token)
    _show_robots(store_url, record)
    return record


@task(name="sync-fleet", task_run_name=named_by(sync_name), cache_policy=NO_CACHE, persist_result=False, **STORE_RETRY)
def sync_fleet(store_url: str, fleet: str, *, token: str) -> JobRecord:
    """Returns what `tasks.deploy.step.sync_fleet` does, shows its progress, and leaves a table of its robots."""
    with show_progress(step.STAGE, "deployment-progress"):
        record = step.sync_fleet(store_url, fleet, token=token)
    _show_robots(store_url, record)
    return record


def _show_robots(store_url: str, record: JobRecord) -> None:
    job = describe_deployment_job(open_store(store_url), record.id)
    said = escape_markdown(deployment_sentence(job, record))
    rows = table_rows(robot_rows(job))
    create_table_artifact(rows, key=artifact_key("deployment-robots"), description=said)
