"""The Prefect task that rolls a version out."""

from collections.abc import Callable, Collection, Mapping
from contextlib import AbstractContextManager

from prefect import task
from prefect.artifacts import create_table_artifact
from prefect.cache_policies import NO_CACHE

from specs.artifact_text import escape_markdown, table_rows
from specs.field_types import Architecture
from specs.pipeline.simulation_section import RollOutRules
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.deploy.answers.describe import describe_deployment_job
from tasks.deploy.answers.row_summary import deployment_sentence, robot_rows
from tasks.deploy.rollout.job import run_deployment_job
from tasks.deploy.trust.signer import DeploymentSigner
from tasks.progress.task import show_progress
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import open_store


@task(name="roll-out", cache_policy=NO_CACHE, persist_result=False)
def roll_out(
    store_url: str,
    request: CreateDeploymentJobRequest,
    *,
    digest: str,
    builds: Mapping[Architecture, str],
    token: str,
    rules: RollOutRules | None = None,
    robots: Callable[[], AbstractContextManager[Collection[str] | None]] | None = None,
    signer: DeploymentSigner | None = None,
) -> JobRecord:
    """Returns the ended deployment job of the token, and leaves a table of its robots; see `run_deployment_job`.

    Args:
        store_url: Where fleet, robots and versions are.
        request: What to deploy where.
        digest: Of the bundle that was tested; the version must be that one.
        builds: Of the bundle for each architecture; the version must have these and no others.
        token: The client request token.
        rules: What RoboMaker's request has no words for.
        robots: Makes the fleet's members, which answer inside its ``with`` block; None if the fleet has its members.
        signer: Signs the bundle and what is asked of each robot; None for an unsigned deployment.
    """
    store = open_store(store_url)
    with show_progress("Deployment", "deployment-progress") as progress:
        record = run_deployment_job(
            store,
            request,
            digest=digest,
            builds=builds,
            token=token,
            progress=progress,
            rules=rules,
            robots=robots,
            signer=signer,
        )
    job = describe_deployment_job(store, record.id)
    said = escape_markdown(deployment_sentence(job, record))
    rows = table_rows(robot_rows(job))
    create_table_artifact(rows, key="deployment-robots", description=said)
    return record
