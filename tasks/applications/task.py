"""Applications as a Prefect task: unpacked where they run."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from prefect import task
from prefect.cache_policies import NO_CACHE

from tasks.applications import step
from tasks.progress.task import STORE_RETRY, named_by


def unpack_name(parameters: Mapping[str, Any]) -> str:
    """Returns what Prefect's pages call the task run, such as ``unpack courier``."""
    return f"unpack {parameters['name'] or parameters['digest'][:12]}"


@task(
    name="unpack-application",
    task_run_name=named_by(unpack_name),
    cache_policy=NO_CACHE,
    persist_result=False,
    **STORE_RETRY,
)
def unpack_application(store_url: str, digest: str, name: str = "") -> Path:
    """Returns what `tasks.applications.step.unpack_application` does."""
    return step.unpack_application(store_url, digest, name)
